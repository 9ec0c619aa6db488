//! Lexicographic local search on the control model.

use super::incremental_rollout::IncrementalRollout;
use super::incumbent::{Ranking, Schedule};
use super::moves::{Line, Plane};
use crate::model::ControlHorizon;

/// Smallest shift of the polish, as a share of nominal power.
const MIN_STEP: f64 = 1e-7;
/// Minimum relative gain of a pass for another pass.
const MIN_RELATIVE_GAIN: f64 = 1e-6;
/// Minimum relative gain of a polish pass for another one.
const MIN_RELATIVE_POLISH_GAIN: f64 = 1e-9;
/// Above this number of strings, each string is paired only with its neighbours in the order of requests.
const ALL_PAIRS: usize = 6;

impl ControlHorizon {
    /// Minimises one group from a schedule `(M, T)` (magnitudes) in the order of a ranking: if the start is above a
    /// ceiling, the excess is reduced first. `budget` limits the work, in string-steps; returns the used part of
    /// it.
    pub(crate) fn descend(&self, start_w: &[f64], ranking: &Ranking, budget: u64) -> (Schedule, u64) {
        let mut tracked = IncrementalRollout::new(self, start_w.to_vec());
        minimise(&mut tracked, ranking, budget);
        let used = tracked.string_steps.get();
        (Schedule { objectives: tracked.objectives(), request_w: tracked.request_w }, used)
    }
}

/// Minimises the groups in order, each under the ceilings of earlier groups.
pub(crate) fn improve(tracked: &mut IncrementalRollout<'_>, budget: u64) {
    let horizon = tracked.horizon;
    let mut ranking = Ranking::new(horizon.n_groups());
    let mut kept = tracked.clone();
    for group in 0..horizon.n_groups() {
        ranking.group = group;
        minimise(tracked, &ranking, budget);
        ranking.ceilings[group] = horizon.ceiling(group, tracked.objectives()[group]);
    }
    // A later group may use the tolerance of an earlier one, never more; a start never becomes worse.
    let (before, after) = (kept.objectives(), tracked.objectives());
    let mut lowest = before;
    for (value, reached) in lowest.iter_mut().zip(after) {
        *value = value.min(reached);
    }
    if Ranking::under(horizon, horizon.n_groups() - 1, &lowest).better(&before, &after) {
        kept.string_steps = tracked.string_steps.clone();
        *tracked = kept;
    }
}

fn minimise(tracked: &mut IncrementalRollout<'_>, ranking: &Ranking, budget: u64) {
    let costs = tracked.objectives();
    // Costs are non-negative: a group at zero is optimal.
    if ranking.excess(&costs) > 0.0 || costs[ranking.group] > 0.0 {
        if ranking.excess(&costs) > 0.0 {
            // Small steps below the ceilings: wide moves may leave the basin of the selected start.
            polish(tracked, ranking, budget);
        }
        search(tracked, ranking, budget);
        polish(tracked, ranking, budget);
    }
}

/// Passes over single steps while they gain, then over pairs of steps; restarts after any gain.
fn search(tracked: &mut IncrementalRollout<'_>, ranking: &Ranking, budget: u64) {
    let apart = |distance| (0..tracked.n_steps() - distance).map(move |step| (step, step + distance));
    let singles: Vec<_> = apart(0).collect();
    let pairs: Vec<_> = (1..tracked.n_steps()).flat_map(apart).collect();
    let mut gains = |in_pairs: bool| {
        let before = tracked.objectives();
        if in_pairs {
            pass(tracked, budget, &pairs, |tracked, (first, second), strings| {
                let lines = (Line::new(tracked, first, strings), Line::new(tracked, second, strings));
                if let (Some(first), Some(second)) = lines {
                    Plane { first, second }.search(tracked, ranking);
                }
            });
        } else {
            pass(tracked, budget, &singles, |tracked, (step, _), strings| {
                if let Some(line) = Line::new(tracked, step, strings) {
                    line.search(tracked, ranking);
                }
            });
        }
        tracked.string_steps.get() < budget
            && ranking.better_by(&tracked.objectives(), &before, MIN_RELATIVE_GAIN)
    };
    while gains(false) || gains(true) {}
}

/// Applies `search` to each pair of strings in each of the steps, within the budget.
fn pass<'a>(
    tracked: &mut IncrementalRollout<'a>,
    budget: u64,
    steps: &[(usize, usize)],
    search: impl Fn(&mut IncrementalRollout<'a>, (usize, usize), (usize, usize)),
) {
    for &steps in steps {
        for strings in pairs(tracked, steps.0) {
            if tracked.string_steps.get() >= budget {
                return;
            }
            search(tracked, steps, strings);
        }
    }
}

/// Shifts that shrink after each pass without a gain.
fn polish(tracked: &mut IncrementalRollout<'_>, ranking: &Ranking, budget: u64) {
    let nominal = |m: usize| tracked.horizon.string(m).nominal_w();
    let largest = (0..tracked.horizon.n_strings()).map(nominal).fold(0.0, f64::max);
    let steps: Vec<_> = (0..tracked.n_steps()).map(|step| (step, step)).collect();
    let mut share = 1e-2;
    while share > MIN_STEP {
        let before = tracked.objectives();
        pass(tracked, budget, &steps, |tracked, (step, _), strings| {
            if let Some(line) = Line::new(tracked, step, strings) {
                line.nudge(tracked, ranking, share * largest);
            }
        });
        if tracked.string_steps.get() >= budget {
            return;
        }
        if !ranking.better_by(&tracked.objectives(), &before, MIN_RELATIVE_POLISH_GAIN) {
            share *= 0.25;
        }
    }
}

/// Pairs of strings to shift power between: all pairs of few strings, or neighbours in the order of requests,
/// so that the work grows linearly with the number of strings.
fn pairs(tracked: &IncrementalRollout<'_>, step: usize) -> Vec<(usize, usize)> {
    let n = tracked.horizon.n_strings();
    if n <= ALL_PAIRS {
        return (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| tracked.request(b, step).total_cmp(&tracked.request(a, step)));
    let ends = (order[0], order[n - 1]);
    order.windows(2).map(|w| (w[0], w[1])).chain([ends]).collect()
}
