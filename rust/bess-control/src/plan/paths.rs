//! An incremental roll-out: a plan with the states and costs of every string, so that a change is evaluated from its step on
//! and for the affected strings only; and co-states, the marginal costs of charge and temperature.

use crate::model::StringState;
use crate::plan::problem::{PlanProblem, Point};

/// Steps of the difference quotients.
const SOC_SHIFT: f64 = 1e-3;
const TEMPERATURE_SHIFT_K: f64 = 0.1;

/// The schedule of one string, rolled out, and its co-states.
#[derive(Debug)]
pub(crate) struct Path<'a> {
    pub problem: &'a PlanProblem<'a>,
    pub string: usize,
    /// `(T,)` [W].
    pub request_w: Vec<f64>,
    /// `(T + 1,)`.
    pub points: Vec<Point>,
    /// Cost, including that of the final state.
    pub total: f64,
    /// Co-states: derivatives of the remaining cost at the start of each step `(T + 1,)`, from a backward pass of difference
    /// quotients along the schedule of the last renewal.
    pub by_soc: Vec<f64>,
    pub by_temperature: Vec<f64>,
    /// Whether this is the present schedule.
    co_states_known: bool,
}

impl<'a> Path<'a> {
    /// A schedule `(T,)` [W] that is not rolled out yet.
    fn at_start(problem: &'a PlanProblem<'a>, string: usize, request_w: Vec<f64>) -> Self {
        let n_points = request_w.len() + 1;
        let first = Point { state: problem.start[string], cost: 0.0, running: problem.running[string] };
        Self {
            problem,
            string,
            request_w,
            points: vec![first; n_points],
            total: 0.0,
            by_soc: vec![0.0; n_points],
            by_temperature: vec![0.0; n_points],
            co_states_known: false,
        }
    }

    /// Rolls the requests out from step `from` on.
    pub fn roll(&mut self, from: usize) {
        (from..self.request_w.len()).for_each(|t| self.advance(t));
        self.add_end_cost();
    }

    #[inline]
    fn advance(&mut self, t: usize) {
        self.points[t + 1] = self.step(t, &self.points[t], self.request_w[t]);
    }

    /// Adds the cost of the final state.
    fn add_end_cost(&mut self) {
        let last = self.points[self.request_w.len()];
        self.total = last.cost + self.problem.end_cost(self.string, last.state);
        self.co_states_known = false;
    }

    /// One step from any point.
    #[inline]
    pub fn step(&self, t: usize, from: &Point, request_w: f64) -> Point {
        self.problem.step(self.string, t, from, request_w)
    }

    /// One step from the present path as a function of the request; coefficients of the state are computed once.
    pub fn choices(&self, t: usize) -> impl Fn(f64) -> Point + '_ {
        let (string, here) = (self.string, self.points[t]);
        let c = self.problem.coefficients(string, t, here.state);
        move |request_w| self.problem.step_from(|| c, (string, t), &here, request_w)
    }

    /// Renews the co-states if the schedule has changed.
    pub fn renew_if_changed(&mut self) {
        if !self.co_states_known {
            self.renew(0);
            self.co_states_known = true;
        }
    }

    /// Renews the co-states from the start of step `from` on.
    pub fn renew(&mut self, from: usize) {
        let n_steps = self.request_w.len();
        self.by_soc[n_steps] = self.problem.prices.end_charge * self.problem.capacity_ah(self.string);
        for t in (from..n_steps).rev() {
            let here = self.points[t];
            let change = |state: StringState| {
                let shifted = self.step(t, &Point { state, ..here }, self.request_w[t]);
                self.change(t + 1, &shifted)
            };
            // Towards the inside of the window: states beyond a limit are invalid.
            let shift = if here.state.soc < 0.5 { SOC_SHIFT } else { -SOC_SHIFT };
            let by_soc = change(StringState { soc: here.state.soc + shift, ..here.state }) / shift;
            let warmer = here.state.temperature_c + TEMPERATURE_SHIFT_K;
            let by_temperature =
                change(StringState { temperature_c: warmer, ..here.state }) / TEMPERATURE_SHIFT_K;
            self.by_soc[t] = by_soc;
            self.by_temperature[t] = by_temperature;
        }
    }

    /// First-order cost of another state at the start of step `t`.
    #[inline]
    pub fn change(&self, t: usize, other: &Point) -> f64 {
        let here = &self.points[t];
        other.cost - here.cost
            + self.by_soc[t] * (other.state.soc - here.state.soc)
            + self.by_temperature[t] * (other.state.temperature_c - here.state.temperature_c)
    }
}

/// A schedule of all strings, rolled out.
#[derive(Debug)]
pub(crate) struct Paths<'a> {
    pub strings: Vec<Path<'a>>,
    /// Steps of single strings computed so far: the measure of effort.
    pub work: u64,
}

impl<'a> Paths<'a> {
    /// A plan `(M, T)` [W].
    pub fn new(problem: &'a PlanProblem<'a>, request_w: &[f64]) -> Self {
        let mut paths = Self::at_start(problem, request_w);
        paths.strings.iter_mut().for_each(|path| path.roll(0));
        paths
    }

    /// The plan of a feedback policy, which returns the requests [W] of a step from its index and the states of the strings.
    pub fn from_policy(
        problem: &'a PlanProblem<'a>,
        mut policy: impl FnMut(usize, &[Point]) -> Vec<f64>,
    ) -> Self {
        let mut paths = Self::at_start(problem, &vec![0.0; problem.n_strings() * problem.n_steps()]);
        for t in 0..problem.n_steps() {
            let points: Vec<_> = paths.strings.iter().map(|path| path.points[t]).collect();
            for (path, request_w) in paths.strings.iter_mut().zip(policy(t, &points)) {
                path.request_w[t] = request_w;
                path.advance(t);
            }
        }
        paths.strings.iter_mut().for_each(Path::add_end_cost);
        paths
    }

    fn at_start(problem: &'a PlanProblem<'a>, request_w: &[f64]) -> Self {
        let n_steps = problem.n_steps();
        let string =
            |m: usize| Path::at_start(problem, m, request_w[m * n_steps..(m + 1) * n_steps].to_vec());
        Self { strings: (0..problem.n_strings()).map(string).collect(), work: request_w.len() as u64 }
    }

    /// Requests `(M, T)` [W].
    pub fn request_w(&self) -> Vec<f64> {
        self.strings.iter().flat_map(|path| path.request_w.iter().copied()).collect()
    }

    pub fn cost(&self) -> f64 {
        self.strings.iter().map(|path| path.total).sum()
    }
}
