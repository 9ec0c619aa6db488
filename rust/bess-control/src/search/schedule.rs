//! Lexicographic local search on the control model.

use super::moves::{Line, Plane};
use super::ranking::Ranking;
use super::walker::Walker;
use crate::model::{ControlHorizon, Costs};

/// Smallest shift of the polish, as a share of nominal power.
const FINEST: f64 = 1e-7;
/// A pass that gains less than this share is the last of its kind.
const WORTHWHILE: f64 = 1e-6;
/// The same for the polish.
const NOTICEABLE: f64 = 1e-9;
/// More strings than this pair up with their neighbours only, in the order of their requests.
const ALL_PAIRS: usize = 3;

/// A schedule and what it costs.
#[derive(Debug, Clone)]
pub struct Schedule {
    /// Requests `(M, T)`, magnitudes [W].
    pub request_w: Vec<f64>,
    /// Objectives of the groups; those beyond the number of groups are zero.
    pub objectives: Costs,
}

impl ControlHorizon {
    /// Local search from some schedules `(B, M, T)` (magnitudes): group after group, each start by itself, the best
    /// taken at the end. `max_rollouts` bounds the work, counted in roll-outs of all strings over all steps; returns the
    /// number used.
    pub fn search(&self, starts_w: &[f64], max_rollouts: usize) -> (Schedule, usize) {
        let size = self.n_strings() * self.n_steps();
        let n_starts = (starts_w.len() / size.max(1)).max(1);
        let mut best: Option<Schedule> = None;
        let mut used = 0;
        for (index, start) in starts_w.chunks_exact(size).enumerate() {
            let share = (max_rollouts.saturating_sub(used)) / (n_starts - index);
            let mut walker = Walker::new(self, 0, &self.start, start.to_vec());
            let budget = (share * size) as u64;
            improve(&mut walker, budget);
            used += (walker.string_steps.get() as usize).div_ceil(size);
            let found = Schedule { objectives: walker.objectives(), request_w: walker.request_w };
            // Both ends have their own best values; the better of them sets the ceilings for the comparison.
            best = Some(match best {
                Some(held) if !self.beats(&found.objectives, &held.objectives) => held,
                _ => found,
            });
        }
        (best.expect("at least one start"), used)
    }

    /// Minimises one group from a schedule `(M, T)` (magnitudes), those before it under their ceilings: where the start is
    /// above one of them, that comes first. `max_rollouts` as in [`Self::search`].
    pub fn descend(
        &self,
        start_w: &[f64],
        group: usize,
        ceilings: &[f64],
        max_rollouts: usize,
    ) -> (Schedule, usize) {
        let size = self.n_strings() * self.n_steps();
        let mut ranking = Ranking::new(self.n_groups());
        ranking.group = group;
        ranking.ceilings[..group].copy_from_slice(&ceilings[..group]);
        let mut walker = Walker::new(self, 0, &self.start, start_w.to_vec());
        minimise(&mut walker, &ranking, (max_rollouts * size) as u64);
        let used = (walker.string_steps.get() as usize).div_ceil(size);
        (Schedule { objectives: walker.objectives(), request_w: walker.request_w }, used)
    }

    /// Whether `a` is better than `b`, with differences within the tolerances of a group left to the next.
    pub(crate) fn beats(&self, a: &Costs, b: &Costs) -> bool {
        let mut ranking = Ranking::new(self.n_groups());
        ranking.group = self.n_groups() - 1;
        for g in 0..ranking.group {
            ranking.ceilings[g] = self.ceiling(g, a[g].min(b[g]));
        }
        ranking.better(a, b)
    }

    /// How far a group may rise above its best value.
    pub(crate) fn ceiling(&self, group: usize, best: f64) -> f64 {
        best + self.tolerance_abs[group].max(self.tolerance_rel[group] * best.abs())
    }
}

/// Minimises one group after the other, each under the ceilings of those before it.
pub(crate) fn improve(walker: &mut Walker<'_>, budget: u64) {
    let horizon = walker.horizon;
    let mut ranking = Ranking::new(horizon.n_groups());
    let mut kept = walker.clone();
    for group in 0..horizon.n_groups() {
        ranking.group = group;
        minimise(walker, &ranking, budget);
        ranking.ceilings[group] = horizon.ceiling(group, walker.objectives()[group]);
    }
    // A later group may have used the tolerance of an earlier one, never more; but a start is never made worse.
    if horizon.beats(&kept.objectives(), &walker.objectives()) {
        kept.string_steps = walker.string_steps.clone();
        *walker = kept;
    }
}

/// Minimises the group of a ranking.
fn minimise(walker: &mut Walker<'_>, ranking: &Ranking, budget: u64) {
    let costs = walker.objectives();
    // Costs are not negative: a group at zero is at its optimum.
    if ranking.excess(&costs) > 0.0 || costs[ranking.group] > 0.0 {
        if ranking.excess(&costs) > 0.0 {
            // Under the ceilings by small steps: wide moves may leave the valley that the start was chosen for.
            polish(walker, ranking, budget);
        }
        descend(walker, ranking, budget);
        polish(walker, ranking, budget);
    }
}

/// Passes over single steps until they gain nothing, then over pairs of steps; from the start after any gain.
fn descend(walker: &mut Walker<'_>, ranking: &Ranking, budget: u64) {
    loop {
        while gains(walker, ranking, budget, single_steps) {}
        if !gains(walker, ranking, budget, pairs_of_steps) {
            return;
        }
    }
}

/// Whether a pass gained enough for another one.
fn gains(walker: &mut Walker<'_>, ranking: &Ranking, budget: u64, pass: Pass) -> bool {
    let before = walker.objectives();
    pass(walker, ranking, budget);
    walker.string_steps.get() < budget && ranking.better_by(&walker.objectives(), &before, WORTHWHILE)
}

type Pass = fn(&mut Walker<'_>, &Ranking, u64);

fn single_steps(walker: &mut Walker<'_>, ranking: &Ranking, budget: u64) {
    for step in walker.first..walker.end {
        for strings in pairs(walker, step) {
            if walker.string_steps.get() >= budget {
                return;
            }
            if let Some(line) = Line::new(walker, step, strings) {
                line.search(walker, ranking);
            }
        }
    }
}

fn pairs_of_steps(walker: &mut Walker<'_>, ranking: &Ranking, budget: u64) {
    for distance in 1..walker.end - walker.first {
        for first in walker.first..walker.end - distance {
            for strings in pairs(walker, first) {
                if walker.string_steps.get() >= budget {
                    return;
                }
                let second = first + distance;
                let lines = (Line::new(walker, first, strings), Line::new(walker, second, strings));
                if let (Some(first), Some(second)) = lines {
                    Plane { first, second }.search(walker, ranking);
                }
            }
        }
    }
}

/// Shifts that shrink whenever a pass gains nothing.
fn polish(walker: &mut Walker<'_>, ranking: &Ranking, budget: u64) {
    let nominal = |m: usize| walker.horizon.string(m).nominal_w();
    let largest = (0..walker.horizon.n_strings()).map(nominal).fold(0.0, f64::max);
    let mut share = 1e-2;
    while share > FINEST {
        let before = walker.objectives();
        for step in walker.first..walker.end {
            for strings in pairs(walker, step) {
                if walker.string_steps.get() >= budget {
                    return;
                }
                if let Some(line) = Line::new(walker, step, strings) {
                    line.nudge(walker, ranking, share * largest);
                }
            }
        }
        if !ranking.better_by(&walker.objectives(), &before, NOTICEABLE) {
            share *= 0.25;
        }
    }
}

/// Pairs of strings to shift power between: all of few, neighbours in the order of their requests of many, so that
/// work grows with the number of strings and not with its square.
fn pairs(walker: &Walker<'_>, step: usize) -> Vec<(usize, usize)> {
    let n = walker.horizon.n_strings();
    if n <= ALL_PAIRS {
        return (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| walker.request(b, step).total_cmp(&walker.request(a, step)));
    let ends = (order[0], order[n - 1]);
    order.windows(2).map(|w| (w[0], w[1])).chain([ends]).collect()
}
