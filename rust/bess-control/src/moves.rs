//! Moves of the local search: power shifted between two strings, in one step or in two.

use bess_tables::Direction;

use crate::horizon::Costs;
use crate::ranking::Ranking;
use crate::walker::Walker;

/// Uniform shares tried in a line search, and in each direction of a two-step search.
const SHARES: usize = 25;
const SHARES_OF_PAIR: usize = 9;

/// A request that does no more than switch the inverter on, as a share of the limit. In charge such an inverter takes
/// its no-load loss from the battery, which makes room in a full one.
const SWITCHED_ON: f64 = 1e-6;

/// Two strings and a step: what the first of them may be asked for while their sum stays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub step: usize,
    pub strings: (usize, usize),
    sum_w: f64,
    low_w: f64,
    high_w: f64,
}

impl Line {
    /// None where nothing can be shifted.
    pub fn new(walker: &Walker<'_>, step: usize, (i, j): (usize, usize)) -> Option<Self> {
        let horizon = walker.horizon;
        let sum_w = walker.request(i, step) + walker.request(j, step);
        let low_w = (sum_w - horizon.limit(j, step)).max(0.0);
        let high_w = horizon.limit(i, step).min(sum_w);
        let line = Self { step, strings: (i, j), sum_w, low_w, high_w };
        (line.width() > 1e-9 * sum_w).then_some(line)
    }

    pub fn width(&self) -> f64 {
        self.high_w - self.low_w
    }

    /// Requests of both strings for a first one inside the line.
    fn pair(&self, first_w: f64) -> (f64, f64) {
        let first = first_w.clamp(self.low_w, self.high_w);
        (first, (self.sum_w - first).max(0.0))
    }

    /// Objectives with the first string at `first_w`.
    fn cost(&self, walker: &Walker<'_>, first_w: f64) -> Costs {
        let (i, j) = self.strings;
        let (u, v) = self.pair(first_w);
        let end = walker.end;
        let a = walker.advance(i, *walker.at(i, self.step), self.step, end, u);
        let b = walker.advance(j, *walker.at(j, self.step), self.step, end, v);
        walker.objectives_with(&[(i, a.costs), (j, b.costs)])
    }

    /// Asks the first string for `first_w` and the other for the rest.
    fn commit(&self, walker: &mut Walker<'_>, first_w: f64) {
        let (i, j) = self.strings;
        let (u, v) = self.pair(first_w);
        walker.set(i, self.step, u);
        walker.set(j, self.step, v);
        walker.roll(i, self.step);
        walker.roll(j, self.step);
    }

    /// The first request at which a string starts to shed.
    fn saturation(&self, walker: &Walker<'_>, m: usize) -> f64 {
        let horizon = walker.horizon;
        let state = walker.at(m, self.step).state;
        let interval = &horizon.intervals[self.step];
        let c = horizon.string(m).coefficients(interval.direction, state);
        let limit = horizon.string(m).limit_w(&c, interval.direction, state.soc, interval.dt_h);
        if c.derating > 0.0 {
            limit / c.derating
        } else {
            0.0
        }
    }

    fn candidates(&self, walker: &Walker<'_>) -> impl Iterator<Item = f64> {
        let (i, j) = self.strings;
        let special = [self.saturation(walker, i), self.sum_w - self.saturation(walker, j)];
        let (low, high) = (self.low_w, self.high_w);
        let inside = special.into_iter().filter(move |u| *u > low && *u < high);
        let uniform = (0..SHARES).map(move |n| low + (high - low) * n as f64 / (SHARES - 1) as f64);
        uniform.chain(inside).chain(self.ends(walker))
    }

    /// Just inside both ends: the string there is on and does nothing. Of use in charge only.
    fn ends(&self, walker: &Walker<'_>) -> impl Iterator<Item = f64> {
        let shift = SWITCHED_ON * self.width();
        let ends = match walker.horizon.direction(self.step) {
            Direction::Charge => vec![self.low_w + shift, self.high_w - shift],
            Direction::Discharge => vec![],
        };
        ends.into_iter()
    }

    /// Uniform requests over the line, and its ends.
    fn grid(&self, walker: &Walker<'_>) -> Vec<f64> {
        let share = |n: usize| self.low_w + self.width() * n as f64 / (SHARES_OF_PAIR - 1) as f64;
        (0..SHARES_OF_PAIR).map(share).chain(self.ends(walker)).collect()
    }

    /// Tries shares, switching and saturation points; then closes in on the best. True if the schedule improved.
    pub fn search(&self, walker: &mut Walker<'_>, ranking: &Ranking) -> bool {
        let here = walker.request(self.strings.0, self.step);
        let mut best = (here, walker.objectives());
        for first_w in self.candidates(walker) {
            self.try_at(walker, ranking, first_w, &mut best);
        }
        let mut step = self.width() / (2 * (SHARES - 1)) as f64;
        while step > 1e-3 * self.width() {
            let centre = best.0;
            self.try_at(walker, ranking, centre - step, &mut best);
            self.try_at(walker, ranking, centre + step, &mut best);
            step *= 0.5;
        }
        self.take(walker, here, best.0)
    }

    /// One shift by `step_w` either way. True if the schedule improved.
    pub fn nudge(&self, walker: &mut Walker<'_>, ranking: &Ranking, step_w: f64) -> bool {
        let here = walker.request(self.strings.0, self.step);
        let mut best = (here, walker.objectives());
        for first_w in [here - step_w, here + step_w] {
            if first_w >= self.low_w && first_w <= self.high_w {
                self.try_at(walker, ranking, first_w, &mut best);
            }
        }
        self.take(walker, here, best.0)
    }

    fn try_at(&self, walker: &Walker<'_>, ranking: &Ranking, first_w: f64, best: &mut (f64, Costs)) {
        if first_w < self.low_w || first_w > self.high_w {
            return;
        }
        let costs = self.cost(walker, first_w);
        if ranking.better(&costs, &best.1) {
            *best = (first_w, costs);
        }
    }

    fn take(&self, walker: &mut Walker<'_>, here: f64, best: f64) -> bool {
        if best == here {
            return false;
        }
        self.commit(walker, best);
        true
    }
}

/// The same two strings in two steps, the first before the second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub first: Line,
    pub second: Line,
}

impl Plane {
    /// Tries a grid of shares in both steps, then closes in. True if the schedule improved.
    pub fn search(&self, walker: &mut Walker<'_>, ranking: &Ranking) -> bool {
        let here = (walker.request(self.first.strings.0, self.first.step), self.here_second(walker));
        let mut best = (here, walker.objectives());
        let seconds = self.second.grid(walker);
        for first_w in self.first.grid(walker) {
            self.try_at(walker, ranking, first_w, seconds.iter().copied(), &mut best);
        }
        let mut step = 0.5 / (SHARES_OF_PAIR - 1) as f64;
        while step > 1e-3 {
            let (x, y) = best.0;
            let (dx, dy) = (step * self.first.width(), step * self.second.width());
            let before = best.0;
            for shift in [-1.0, 0.0, 1.0] {
                let seconds = [-1.0, 0.0, 1.0].into_iter().map(|s| y + s * dy);
                self.try_at(walker, ranking, x + shift * dx, seconds, &mut best);
            }
            if best.0 == before {
                step *= 0.5;
            }
        }
        if best.0 == here {
            return false;
        }
        self.first.commit(walker, best.0 .0);
        self.second.commit(walker, best.0 .1);
        true
    }

    fn here_second(&self, walker: &Walker<'_>) -> f64 {
        walker.request(self.second.strings.0, self.second.step)
    }

    /// One first request against several second ones; the way to the second step is rolled out once.
    fn try_at(
        &self,
        walker: &Walker<'_>,
        ranking: &Ranking,
        first_w: f64,
        seconds_w: impl Iterator<Item = f64>,
        best: &mut ((f64, f64), Costs),
    ) {
        let inside = |line: &Line, w: f64| w >= line.low_w && w <= line.high_w;
        if !inside(&self.first, first_w) {
            return;
        }
        let (i, j) = self.first.strings;
        let (from, to, end) = (self.first.step, self.second.step, walker.end);
        let (u, v) = self.first.pair(first_w);
        let a = walker.advance(i, *walker.at(i, from), from, to, u);
        let b = walker.advance(j, *walker.at(j, from), from, to, v);
        for second_w in seconds_w.filter(|w| inside(&self.second, *w)) {
            let (u, v) = self.second.pair(second_w);
            let a = walker.advance(i, a, to, end, u);
            let b = walker.advance(j, b, to, end, v);
            let costs = walker.objectives_with(&[(i, a.costs), (j, b.costs)]);
            if ranking.better(&costs, &best.1) {
                *best = ((first_w, second_w), costs);
            }
        }
    }
}
