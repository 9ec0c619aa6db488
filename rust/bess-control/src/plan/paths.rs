//! A plan with the state and the cost of every string along it, so that a change is costed from the changed step on and
//! only for the strings that it touches.

use crate::model::StringState;
use crate::plan::problem::PlanProblem;

/// A string at the start of a step: state, accumulated cost, inverter state.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub state: StringState,
    pub cost: f64,
    pub running: bool,
}

/// A schedule, rolled out.
#[derive(Debug, Clone)]
pub(crate) struct Paths<'a> {
    pub problem: &'a PlanProblem<'a>,
    /// `(M, T)` [W].
    pub request_w: Vec<f64>,
    /// `(M, T + 1)`.
    points: Vec<Point>,
    /// Cost of each string, that of its end included `(M,)`.
    totals: Vec<f64>,
    /// Steps of single strings computed so far: the measure of effort.
    pub work: u64,
}

impl<'a> Paths<'a> {
    /// A plan `(M, T)` [W].
    pub fn new(problem: &'a PlanProblem<'a>, request_w: Vec<f64>) -> Self {
        let mut paths = Self::at_start(problem, request_w);
        for m in 0..problem.n_strings() {
            paths.roll(m, 0);
        }
        paths
    }

    /// The plan whose requests of a step `share` gives, by its number and where the strings stand [W].
    pub fn shared(
        problem: &'a PlanProblem<'a>,
        mut share: impl FnMut(usize, &[StringState]) -> Vec<f64>,
    ) -> Self {
        let (n_strings, n_steps) = (problem.n_strings(), problem.n_steps());
        let mut paths = Self::at_start(problem, vec![0.0; n_strings * n_steps]);
        for t in 0..n_steps {
            let states: Vec<_> = (0..n_strings).map(|m| paths.at(m, t).state).collect();
            for (m, request_w) in share(t, &states).into_iter().enumerate() {
                paths.set(m, t, request_w);
                paths.advance(m, t);
            }
        }
        (0..n_strings).for_each(|m| paths.close(m));
        paths.work += (n_strings * n_steps) as u64;
        paths
    }

    fn at_start(problem: &'a PlanProblem<'a>, request_w: Vec<f64>) -> Self {
        let (n_strings, n_steps) = (problem.n_strings(), problem.n_steps());
        let first = |m: usize| Point { state: problem.start[m], cost: 0.0, running: problem.running[m] };
        let points = (0..n_strings).flat_map(|m| std::iter::repeat_n(first(m), n_steps + 1)).collect();
        Self { problem, request_w, points, totals: vec![0.0; n_strings], work: 0 }
    }

    #[inline]
    pub fn request(&self, m: usize, t: usize) -> f64 {
        self.request_w[m * self.problem.n_steps() + t]
    }

    /// Sets a request; the path is stale until [`Self::roll`].
    #[inline]
    pub fn set(&mut self, m: usize, t: usize, request_w: f64) {
        let index = m * self.problem.n_steps() + t;
        self.request_w[index] = request_w;
    }

    /// Where a string stands at the start of a step.
    #[inline]
    pub fn at(&self, m: usize, t: usize) -> &Point {
        &self.points[m * (self.problem.n_steps() + 1) + t]
    }

    /// Cost of one string.
    #[inline]
    pub fn total(&self, m: usize) -> f64 {
        self.totals[m]
    }

    /// Cost of the plan.
    pub fn cost(&self) -> f64 {
        self.totals.iter().sum()
    }

    /// One step of a string from any point.
    #[inline]
    pub fn next(&self, m: usize, t: usize, point: &Point, request_w: f64) -> Point {
        let (cost, state) = self.problem.step(m, t, point.state, request_w, point.running);
        Point { state, cost: point.cost + cost, running: request_w > 0.0 }
    }

    /// Rolls a string out again from a step on.
    pub fn roll(&mut self, m: usize, from: usize) {
        let n_steps = self.problem.n_steps();
        (from..n_steps).for_each(|t| self.advance(m, t));
        self.close(m);
        self.work += (n_steps - from) as u64;
    }

    /// Where a string stands after a step.
    #[inline]
    fn advance(&mut self, m: usize, t: usize) {
        let after = self.next(m, t, self.at(m, t), self.request(m, t));
        self.points[m * (self.problem.n_steps() + 1) + t + 1] = after;
    }

    /// The cost of a string with that of its end.
    fn close(&mut self, m: usize) {
        let last = self.at(m, self.problem.n_steps());
        self.totals[m] = last.cost + self.problem.end_cost(m, last.state);
    }
}
