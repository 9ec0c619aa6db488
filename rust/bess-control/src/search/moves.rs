//! Moves of the local search: power shifted between two strings, in one step or in two.

use bess_tables::Direction;

use super::incremental_rollout::IncrementalRollout;
use super::incumbent::Ranking;
use crate::model::Objectives;

/// Uniform shares tried in a line search, and in each direction of a two-step search.
const SHARES: usize = 25;
const SHARES_OF_PAIR: usize = 9;

/// Maximum number of refinements of a two-step search.
const MAX_REFINEMENTS: usize = 15;

/// Evaluations to find the intersection with a ceiling.
const CROSSING: usize = 4;

/// Two strings and a step: range of requests of the first string at a constant sum.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub step: usize,
    pub strings: (usize, usize),
    sum_w: f64,
    low_w: f64,
    high_w: f64,
}

impl Line {
    /// None if no power can be shifted.
    pub fn new(tracked: &IncrementalRollout<'_>, step: usize, (i, j): (usize, usize)) -> Option<Self> {
        let horizon = tracked.horizon;
        let sum_w = tracked.request(i, step) + tracked.request(j, step);
        let low_w = (sum_w - horizon.limit(j, step)).max(0.0);
        let high_w = horizon.limit(i, step).min(sum_w);
        let line = Self { step, strings: (i, j), sum_w, low_w, high_w };
        (line.width() > 1e-9 * sum_w).then_some(line)
    }

    pub fn width(&self) -> f64 {
        self.high_w - self.low_w
    }

    /// Requests of both strings for a first request within the range.
    fn pair(&self, tracked: &IncrementalRollout<'_>, first_w: f64) -> (f64, f64) {
        let first_w = first_w.clamp(self.low_w, self.high_w);
        tracked.horizon.pair(self.step, self.strings, self.sum_w, first_w)
    }

    /// Objectives with the first string at `first_w`; later requests are unchanged, or strings stay on their
    /// edges.
    fn cost(&self, tracked: &IncrementalRollout<'_>, shift: Shift) -> Objectives {
        let (i, j) = self.strings;
        let (u, v) = self.pair(tracked, shift.first_w);
        let (a, b) = if shift.follows {
            tracked.follow(self.strings, self.step, (u, v), |_, _| ())
        } else {
            let a = tracked.advance(i, *tracked.at(i, self.step), self.step, tracked.n_steps(), u);
            let b = tracked.advance(j, *tracked.at(j, self.step), self.step, tracked.n_steps(), v);
            (a.costs, b.costs)
        };
        tracked.objectives_with(&[(i, a), (j, b)])
    }

    /// Sets the request of the first string to `first_w`, and the remainder for the other.
    fn commit(&self, tracked: &mut IncrementalRollout<'_>, shift: Shift) {
        let (i, j) = self.strings;
        let pair = self.pair(tracked, shift.first_w);
        let mut changes = vec![(self.step, pair)];
        if shift.follows {
            changes.clear();
            tracked.follow(self.strings, self.step, pair, |t, pair| changes.push((t, pair)));
        }
        for (t, (u, v)) in changes {
            tracked.set(i, t, u);
            tracked.set(j, t, v);
        }
        tracked.roll(i, self.step);
        tracked.roll(j, self.step);
    }

    fn candidates(&self, tracked: &IncrementalRollout<'_>) -> impl Iterator<Item = f64> {
        let edge = |m: usize| tracked.edge(m, self.step, tracked.at(m, self.step));
        let special = [edge(self.strings.0), self.sum_w - edge(self.strings.1)];
        let (low, high) = (self.low_w, self.high_w);
        let inside = special.into_iter().filter(move |u| *u > low && *u < high);
        let uniform = (0..SHARES).map(move |n| low + (high - low) * n as f64 / (SHARES - 1) as f64);
        uniform.chain(inside).chain(self.ends(tracked))
    }

    /// Just inside both ends: the string there is at its minimum power. In charge such an inverter takes its
    /// no-load loss from the battery, which creates headroom in a full battery.
    fn ends(&self, tracked: &IncrementalRollout<'_>) -> impl Iterator<Item = f64> {
        let min_w = |m: usize| tracked.horizon.string(m).min_power_w();
        let charges = tracked.horizon.direction(self.step) == Direction::Charge;
        let (first_w, second_w) = (min_w(self.strings.0), self.sum_w - min_w(self.strings.1));
        let (low, high) = (self.low_w, self.high_w);
        [first_w, second_w].into_iter().filter(move |u| charges && *u > low && *u < high)
    }

    /// Uniform requests over the range, and its ends.
    fn grid(&self, tracked: &IncrementalRollout<'_>) -> Vec<f64> {
        let share = |n: usize| self.low_w + self.width() * n as f64 / (SHARES_OF_PAIR - 1) as f64;
        (0..SHARES_OF_PAIR).map(share).chain(self.ends(tracked)).collect()
    }

    /// Tries shares, switching points and edges; then refines the best.
    pub fn search(&self, tracked: &mut IncrementalRollout<'_>, ranking: &Ranking) {
        let first_w = self.width() / (2 * (SHARES - 1)) as f64;
        let halves = std::iter::successors(Some(first_w), |step_w| Some(0.5 * step_w));
        let steps_w = halves.take_while(|step_w| *step_w > 1e-3 * self.width());
        self.improve(tracked, ranking, self.candidates(tracked), steps_w);
    }

    /// One shift by `step_w` in either direction.
    pub fn nudge(&self, tracked: &mut IncrementalRollout<'_>, ranking: &Ranking, step_w: f64) {
        self.improve(tracked, ranking, [], [step_w]);
    }

    /// Takes the best of some requests of the first string, then of shifts from the best in either direction.
    fn improve(
        &self,
        tracked: &mut IncrementalRollout<'_>,
        ranking: &Ranking,
        requests_w: impl IntoIterator<Item = f64>,
        steps_w: impl IntoIterator<Item = f64>,
    ) {
        let here = Shift { first_w: tracked.request(self.strings.0, self.step), follows: false };
        let mut best = (here, tracked.objectives());
        for first_w in requests_w {
            self.try_at(tracked, ranking, first_w, &mut best);
        }
        for step_w in steps_w {
            let centre_w = best.0.first_w;
            self.try_at(tracked, ranking, centre_w - step_w, &mut best);
            self.try_at(tracked, ranking, centre_w + step_w, &mut best);
        }
        if best.0 != here {
            self.commit(tracked, best.0);
        }
    }

    fn try_at(
        &self,
        tracked: &IncrementalRollout<'_>,
        ranking: &Ranking,
        first_w: f64,
        best: &mut (Shift, Objectives),
    ) {
        if first_w < self.low_w || first_w > self.high_w {
            return;
        }
        for follows in [false, true] {
            if follows && !tracked.has_edge_after(self.strings, self.step) {
                continue;
            }
            let shift = Shift { first_w, follows };
            let costs = self.cost(tracked, shift);
            if ranking.better(&costs, &best.1) {
                *best = (shift, costs);
            }
        }
    }
}

/// A new request of the first string, and whether strings that are on their edge later stay on it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shift {
    first_w: f64,
    follows: bool,
}

/// The same two strings in two steps, the first before the second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub first: Line,
    pub second: Line,
}

impl Plane {
    /// Tries a grid of shares in both steps, then refines the best.
    pub fn search(&self, tracked: &mut IncrementalRollout<'_>, ranking: &Ranking) {
        let at = |line: &Line| tracked.request(line.strings.0, line.step);
        let here = (at(&self.first), at(&self.second));
        let mut best = (here, tracked.objectives());
        let mut seconds = self.second.grid(tracked);
        seconds.sort_by(f64::total_cmp);
        for first_w in self.first.grid(tracked) {
            self.try_row(tracked, ranking, first_w, &seconds, &mut best);
        }
        let mut step = 0.5 / (SHARES_OF_PAIR - 1) as f64;
        for _ in 0..MAX_REFINEMENTS {
            if step < 1e-3 {
                break;
            }
            let (x, y) = best.0;
            let (dx, dy) = (step * self.first.width(), step * self.second.width());
            let before = best.0;
            for shift in [-1.0, 0.0, 1.0] {
                self.try_row(tracked, ranking, x + shift * dx, &[y - dy, y, y + dy], &mut best);
            }
            if best.0 == before {
                step *= 0.5;
            }
        }
        if best.0 != here {
            let (first_w, second_w) = best.0;
            self.first.commit(tracked, Shift { first_w, follows: false });
            self.second.commit(tracked, Shift { first_w: second_w, follows: false });
        }
    }

    /// Schedules with one first request and several ascending second ones, and intermediate ones that just
    /// meet the ceilings. The roll-out to the second step is computed once.
    fn try_row(
        &self,
        tracked: &IncrementalRollout<'_>,
        ranking: &Ranking,
        first_w: f64,
        seconds_w: &[f64],
        best: &mut ((f64, f64), Objectives),
    ) {
        let inside = |line: &Line, w: f64| w >= line.low_w && w <= line.high_w;
        if !inside(&self.first, first_w) {
            return;
        }
        let (i, j) = self.first.strings;
        let (from, to, end) = (self.first.step, self.second.step, tracked.n_steps());
        let (u, v) = self.first.pair(tracked, first_w);
        let a = tracked.advance(i, *tracked.at(i, from), from, to, u);
        let b = tracked.advance(j, *tracked.at(j, from), from, to, v);
        let costs_at = |second_w: f64| {
            let (u, v) = self.second.pair(tracked, second_w);
            let a = tracked.advance(i, a, to, end, u);
            let b = tracked.advance(j, b, to, end, v);
            tracked.objectives_with(&[(i, a.costs), (j, b.costs)])
        };
        let best_cost = best.1[ranking.group];
        let mut consider = |second_w: f64, costs: &Objectives| {
            if ranking.better(costs, &best.1) {
                *best = ((first_w, second_w), *costs);
            }
        };
        let mut before: Option<(f64, Objectives)> = None;
        for &second_w in seconds_w.iter().filter(|w| inside(&self.second, **w)) {
            let costs = costs_at(second_w);
            consider(second_w, &costs);
            if let Some((other_w, other)) = before {
                let mut cross = |excess: &dyn Fn(&Objectives) -> f64| {
                    let ends = [(other_w, excess(&other)), (second_w, excess(&costs))];
                    let crosses = (ends[0].1 > 0.0) != (ends[1].1 > 0.0);
                    if crosses {
                        // Evaluated if the straight line between both ends is below the best.
                        let part = ends[0].1 / (ends[0].1 - ends[1].1);
                        let g = ranking.group;
                        if other[g] + (costs[g] - other[g]) * part < best_cost {
                            let met = crossing(ends, |w| excess(&costs_at(w)));
                            consider(met, &costs_at(met));
                        }
                    }
                    crosses
                };
                if !cross(&|costs| ranking.excess(costs)) {
                    // The ends exceed different ceilings: a point in between may meet both.
                    for group in 0..ranking.group {
                        cross(&|costs| costs[group] - ranking.ceilings[group]);
                    }
                }
            }
            before = Some((second_w, costs));
        }
    }
}

/// Root of a function with different signs at both ends, on the non-positive side: false position, with half
/// weight for a retained end (Illinois).
fn crossing(ends: [(f64, f64); 2], excess: impl Fn(f64) -> f64) -> f64 {
    let [mut inside, mut outside] = if ends[0].1 > 0.0 { [ends[1], ends[0]] } else { ends };
    for _ in 0..CROSSING {
        let w = inside.0 + (outside.0 - inside.0) * inside.1 / (inside.1 - outside.1);
        let value = excess(w);
        if value > 0.0 {
            outside = (w, value);
            inside.1 *= 0.5;
        } else {
            inside = (w, value);
            outside.1 *= 0.5;
        }
    }
    inside.0
}
