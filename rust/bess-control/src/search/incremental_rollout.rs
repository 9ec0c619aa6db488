//! A schedule with its states and costs, so that a change is evaluated from the changed step on and only
//! for the affected strings.

use crate::model::{
    total, Coefficients, CoefficientsFrom, ControlHorizon, Interval, Objectives, StringState, BLOCK,
    MAX_GROUPS,
};

/// Relative distance from the deliverable power within which a request counts as equal to it (on its edge).
const EDGE_WIDTH: f64 = 1e-9;

/// State and cost of a string at the start of a step of a roll-out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Progress {
    state: StringState,
    /// Of the next step; many requests are tried from one state.
    coefficients: Coefficients,
    pub costs: Objectives,
}

/// A schedule, rolled out.
#[derive(Debug, Clone)]
pub(crate) struct IncrementalRollout<'a> {
    pub horizon: &'a ControlHorizon,
    /// `(M, T)` [W].
    pub request_w: Vec<f64>,
    /// `(M, T + 1)`: at the start of each step, and at the end.
    progress: Vec<Progress>,
    /// Costs of each block of strings.
    blocks: Vec<Objectives>,
    /// `(M, T)`: whether a request is equal to the deliverable power.
    on_edge: Vec<bool>,
    /// String-steps computed so far.
    pub string_steps: std::cell::Cell<u64>,
}

impl<'a> IncrementalRollout<'a> {
    pub fn new(horizon: &'a ControlHorizon, request_w: Vec<f64>) -> Self {
        let row = |(m, &state): (usize, &StringState)| {
            let coefficients = horizon.string(m).coefficients(horizon.direction(0), state);
            vec![Progress { state, coefficients, costs: [0.0; MAX_GROUPS] }; horizon.n_steps() + 1]
        };
        let mut tracked = Self {
            horizon,
            progress: horizon.start.iter().enumerate().flat_map(row).collect(),
            blocks: vec![[0.0; MAX_GROUPS]; horizon.n_strings().div_ceil(BLOCK)],
            on_edge: vec![false; request_w.len()],
            request_w,
            string_steps: 0.into(),
        };
        (0..horizon.n_strings()).for_each(|m| tracked.roll(m, 0));
        tracked
    }

    #[inline]
    pub fn n_steps(&self) -> usize {
        self.horizon.n_steps()
    }

    #[inline]
    pub fn request(&self, m: usize, t: usize) -> f64 {
        self.request_w[m * self.n_steps() + t]
    }

    /// State of a string at the start of a step.
    #[inline]
    pub fn at(&self, m: usize, t: usize) -> &Progress {
        &self.progress[m * (self.n_steps() + 1) + t]
    }

    /// Sets a request; the progress is stale until [`Self::roll`].
    pub fn set(&mut self, m: usize, t: usize, request_w: f64) {
        let index = m * self.n_steps() + t;
        self.request_w[index] = request_w;
    }

    /// Rolls out a string again from a step on.
    pub fn roll(&mut self, m: usize, from: usize) {
        let base = m * (self.n_steps() + 1);
        for t in from..self.n_steps() {
            let mut next = self.progress[base + t];
            let edge_w = self.edge(m, t, &next);
            let index = m * self.n_steps() + t;
            self.on_edge[index] =
                edge_w > 0.0 && (self.request_w[index] - edge_w).abs() < EDGE_WIDTH * edge_w;
            self.step(m, t, &mut next, self.request(m, t));
            self.prepare(m, t + 1, &mut next);
            self.progress[base + t + 1] = next;
        }
        self.blocks[m / BLOCK] = self.block_with(m / BLOCK, &[]);
        self.count(self.n_steps() - from);
    }

    /// Advances a string from step `from` to the start of step `to`, with `request_w` in the first step.
    #[inline]
    pub fn advance(
        &self,
        m: usize,
        mut progress: Progress,
        from: usize,
        to: usize,
        request_w: f64,
    ) -> Progress {
        self.step(m, from, &mut progress, request_w);
        for t in from + 1..to {
            self.prepare(m, t, &mut progress);
            self.step(m, t, &mut progress, self.request(m, t));
        }
        self.prepare(m, to, &mut progress);
        self.count(to - from);
        progress
    }

    /// Advances a string by one step; the coefficients are stale until [`Self::prepare`].
    #[inline]
    fn step(&self, m: usize, t: usize, progress: &mut Progress, request_w: f64) {
        let Progress { state, coefficients, costs } = progress;
        let string = self.horizon.string(m);
        let interval = &self.horizon.intervals[t];
        let (from, curve) = (CoefficientsFrom::Start, string.loss(interval.direction));
        let flow = string.step_with(from, curve, || *coefficients, *state, request_w, interval);
        self.horizon.add_costs(m, &flow, costs);
        *state = flow.end;
    }

    /// Coefficients of the step that begins, if any.
    #[inline]
    fn prepare(&self, m: usize, t: usize, progress: &mut Progress) {
        if t < self.n_steps() {
            let direction = self.horizon.direction(t);
            progress.coefficients = self.horizon.string(m).coefficients(direction, progress.state);
        }
    }

    /// Maximum request of a string in this state without availability loss.
    pub fn edge(&self, m: usize, t: usize, progress: &Progress) -> f64 {
        let Progress { state, coefficients: c, .. } = progress;
        if c.derating <= 0.0 {
            return 0.0;
        }
        let Interval { direction, dt_h, .. } = self.horizon.intervals[t];
        self.horizon.string(m).deliverable_w(c, direction, state.soc, dt_h) / c.derating
    }

    /// Whether either string is on its edge after a step, so that [`Self::follow`] differs from [`Self::advance`].
    pub fn has_edge_after(&self, (i, j): (usize, usize), step: usize) -> bool {
        let row = |m: usize| &self.on_edge[m * self.n_steps() + step + 1..(m + 1) * self.n_steps()];
        row(i).iter().any(|&e| e) || row(j).iter().any(|&e| e)
    }

    /// Advances two strings from a step to the end like [`Self::advance`], but a string that was on its edge stays
    /// on it, and the other takes the remainder: the optimum is often at such a kink, which moves with the state.
    pub fn follow(
        &self,
        (i, j): (usize, usize),
        from: usize,
        first_w: (f64, f64),
        mut visit: impl FnMut(usize, (f64, f64)),
    ) -> (Objectives, Objectives) {
        let (mut a, mut b) = (*self.at(i, from), *self.at(j, from));
        let mut request = first_w;
        for t in from..self.n_steps() {
            if t > from {
                self.prepare(i, t, &mut a);
                self.prepare(j, t, &mut b);
                let (u, v) = (self.request(i, t), self.request(j, t));
                let (low, high) =
                    ((u + v - self.horizon.limit(j, t)).max(0.0), self.horizon.limit(i, t).min(u + v));
                let index = |m: usize| m * self.n_steps() + t;
                let wanted = if self.on_edge[index(i)] {
                    self.edge(i, t, &a)
                } else if self.on_edge[index(j)] {
                    u + v - self.edge(j, t, &b)
                } else {
                    u
                };
                // No move if the range is empty (bounds that cross by rounding).
                let first = if low <= high { wanted.clamp(low, high) } else { u };
                request = self.horizon.pair(t, (i, j), u + v, first);
            }
            visit(t, request);
            self.step(i, t, &mut a, request.0);
            self.step(j, t, &mut b, request.1);
        }
        self.count(2 * (self.n_steps() - from));
        (a.costs, b.costs)
    }

    /// Objectives with the final costs of some strings replaced.
    #[inline]
    pub fn objectives_with(&self, changed: &[(usize, Objectives)]) -> Objectives {
        total(self.blocks.iter().enumerate().map(|(block, costs)| {
            let is_changed = changed.iter().any(|(string, _)| string / BLOCK == block);
            if is_changed {
                self.block_with(block, changed)
            } else {
                *costs
            }
        }))
    }

    /// Costs of a block of strings with the final costs of some replaced.
    #[inline]
    fn block_with(&self, block: usize, changed: &[(usize, Objectives)]) -> Objectives {
        let strings = block * BLOCK..((block + 1) * BLOCK).min(self.horizon.n_strings());
        total(strings.map(|m| {
            let replaced = changed.iter().find(|(string, _)| *string == m);
            replaced.map_or(self.at(m, self.n_steps()).costs, |(_, costs)| *costs)
        }))
    }

    pub fn objectives(&self) -> Objectives {
        self.objectives_with(&[])
    }

    #[inline]
    fn count(&self, steps: usize) {
        self.string_steps.set(self.string_steps.get() + steps as u64);
    }
}
