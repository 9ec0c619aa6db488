//! A plan with the state and the cost of every string along it, so that a change is costed from the changed step on and
//! only for the strings that it touches; and the co-states along it, the marginal cost of charge and temperature.

use crate::model::StringState;
use crate::plan::problem::{PlanProblem, Point};

/// Steps of the difference quotients.
const SOC_SHIFT: f64 = 1e-3;
const TEMPERATURE_SHIFT_K: f64 = 0.1;

#[derive(Debug, Clone, Default)]
struct Path {
    /// `(T,)` [W].
    request_w: Vec<f64>,
    /// `(T + 1,)`.
    points: Vec<Point>,
    /// Cost, that of the end included.
    total: f64,
    /// Along the present path, if known.
    co_states: Option<CoStates>,
}

/// A schedule, rolled out.
#[derive(Debug, Clone)]
pub(crate) struct Paths<'a> {
    pub problem: &'a PlanProblem<'a>,
    strings: Vec<Path>,
    /// Steps of single strings computed so far: the measure of effort.
    pub work: u64,
}

impl<'a> Paths<'a> {
    /// A plan `(M, T)` [W].
    pub fn new(problem: &'a PlanProblem<'a>, request_w: Vec<f64>) -> Self {
        let mut paths = Self::at_start(problem, &request_w);
        for m in 0..problem.n_strings() {
            paths.roll(m, 0);
        }
        paths
    }

    /// The plan whose requests of a step `share` gives, by its index and where the strings stand [W].
    pub fn shared(problem: &'a PlanProblem<'a>, mut share: impl FnMut(usize, &[Point]) -> Vec<f64>) -> Self {
        let (n_strings, n_steps) = (problem.n_strings(), problem.n_steps());
        let mut paths = Self::at_start(problem, &vec![0.0; n_strings * n_steps]);
        for t in 0..n_steps {
            let points: Vec<_> = (0..n_strings).map(|m| *paths.at(m, t)).collect();
            for (m, request_w) in share(t, &points).into_iter().enumerate() {
                paths.set(m, t, request_w);
                paths.advance(m, t);
            }
        }
        (0..n_strings).for_each(|m| paths.close(m));
        paths.work += (n_strings * n_steps) as u64;
        paths
    }

    fn at_start(problem: &'a PlanProblem<'a>, request_w: &[f64]) -> Self {
        let n_steps = problem.n_steps();
        let string = |m: usize| {
            let first = Point { state: problem.start[m], cost: 0.0, running: problem.running[m] };
            let request_w = request_w[m * n_steps..(m + 1) * n_steps].to_vec();
            Path { request_w, points: vec![first; n_steps + 1], total: 0.0, co_states: None }
        };
        Self { problem, strings: (0..problem.n_strings()).map(string).collect(), work: 0 }
    }

    /// Requests `(M, T)` [W].
    pub fn request_w(&self) -> Vec<f64> {
        self.strings.iter().flat_map(|string| string.request_w.iter().copied()).collect()
    }

    /// Takes the schedules of two strings, to be changed on another thread, and [`Self::put_back`].
    pub fn take(&mut self, two: [usize; 2]) -> Self {
        let strings = vec![Path::default(); self.strings.len()];
        let mut part = Self { problem: self.problem, strings, work: 0 };
        part.exchange(self, two);
        part
    }

    /// Puts the schedules of two strings back.
    pub fn put_back(&mut self, two: [usize; 2], mut part: Self) {
        part.exchange(self, two);
        self.work += part.work;
    }

    fn exchange(&mut self, other: &mut Self, two: [usize; 2]) {
        for m in two {
            std::mem::swap(&mut self.strings[m], &mut other.strings[m]);
        }
    }

    #[inline]
    pub fn request(&self, m: usize, t: usize) -> f64 {
        self.strings[m].request_w[t]
    }

    /// Sets a request; the path is stale until [`Self::roll`].
    #[inline]
    pub fn set(&mut self, m: usize, t: usize, request_w: f64) {
        self.strings[m].request_w[t] = request_w;
    }

    /// Where a string stands at the start of a step.
    #[inline]
    pub fn at(&self, m: usize, t: usize) -> &Point {
        &self.strings[m].points[t]
    }

    /// Cost of one string.
    #[inline]
    pub fn total(&self, m: usize) -> f64 {
        self.strings[m].total
    }

    pub fn cost(&self) -> f64 {
        self.strings.iter().map(|string| string.total).sum()
    }

    /// One step of a string from its present path, by the request: what depends on the state alone is computed once.
    pub fn choices(&self, m: usize, t: usize) -> impl Fn(f64) -> Point + '_ {
        let here = *self.at(m, t);
        let c = self.problem.coefficients(m, t, here.state);
        move |request_w| self.problem.step_from(|| c, (m, t), &here, request_w)
    }

    pub fn roll(&mut self, m: usize, from: usize) {
        let n_steps = self.problem.n_steps();
        (from..n_steps).for_each(|t| self.advance(m, t));
        self.close(m);
        self.strings[m].co_states = None;
        self.work += (n_steps - from) as u64;
    }

    #[inline]
    fn advance(&mut self, m: usize, t: usize) {
        let after = self.problem.step(m, t, self.at(m, t), self.request(m, t));
        self.strings[m].points[t + 1] = after;
    }

    /// The cost of a string with that of its end.
    fn close(&mut self, m: usize) {
        let last = *self.at(m, self.problem.n_steps());
        self.strings[m].total = last.cost + self.problem.end_cost(m, last.state);
    }
}

/// Co-states of one string: derivatives of the remaining cost at the start of each step `(T + 1,)`, from a backward
/// pass of difference quotients along its schedule.
#[derive(Debug, Clone)]
pub(crate) struct CoStates {
    pub soc: Vec<f64>,
    pub temperature: Vec<f64>,
}

impl CoStates {
    /// Co-states of a schedule are computed once, but count as work whenever they are asked for.
    pub fn along(paths: &mut Paths<'_>, m: usize) -> Self {
        let n_steps = paths.problem.n_steps();
        if let Some(known) = paths.strings[m].co_states.clone() {
            paths.work += 2 * n_steps as u64;
            return known;
        }
        let mut slopes = Self { soc: vec![0.0; n_steps + 1], temperature: vec![0.0; n_steps + 1] };
        slopes.renew(paths, m, 0);
        paths.strings[m].co_states = Some(slopes.clone());
        slopes
    }

    /// Co-states along the present path, from the start of step `from` on.
    pub fn renew(&mut self, paths: &mut Paths<'_>, m: usize, from: usize) {
        let problem = paths.problem;
        let n_steps = problem.n_steps();
        self.soc[n_steps] = problem.prices.end_charge * problem.capacity_ah(m);
        for t in (from..n_steps).rev() {
            let (here, next) = (*paths.at(m, t), *paths.at(m, t + 1));
            let request_w = paths.request(m, t);
            let change = |state: StringState| {
                let shifted = problem.step(m, t, &Point { state, ..here }, request_w);
                self.change(t + 1, &next, &shifted)
            };
            // Towards the inside of the window: states beyond a limit are invalid.
            let shift = if here.state.soc < 0.5 { SOC_SHIFT } else { -SOC_SHIFT };
            let by_soc = change(StringState { soc: here.state.soc + shift, ..here.state }) / shift;
            let warmer = here.state.temperature_c + TEMPERATURE_SHIFT_K;
            let by_temperature =
                change(StringState { temperature_c: warmer, ..here.state }) / TEMPERATURE_SHIFT_K;
            self.soc[t] = by_soc;
            self.temperature[t] = by_temperature;
        }
        paths.work += 2 * (n_steps - from) as u64;
    }

    /// First-order cost of the state `other` instead of `here` at the start of step `t`.
    #[inline]
    pub fn change(&self, t: usize, here: &Point, other: &Point) -> f64 {
        other.cost - here.cost
            + self.soc[t] * (other.state.soc - here.state.soc)
            + self.temperature[t] * (other.state.temperature_c - here.state.temperature_c)
    }
}
