//! A plan with the state and the cost of every string along it, so that a change is costed from the changed step on and
//! only for the strings that it touches.

use crate::model::StringState;
use crate::plan::co_states::CoStates;
use crate::plan::problem::PlanProblem;

/// A string at the start of a step: state, accumulated cost, inverter state.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub state: StringState,
    pub cost: f64,
    pub running: bool,
}

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

    /// Co-states along the path of a string, if known.
    pub fn co_states(&mut self, m: usize) -> &mut Option<CoStates> {
        &mut self.strings[m].co_states
    }

    /// Cost of one string.
    #[inline]
    pub fn total(&self, m: usize) -> f64 {
        self.strings[m].total
    }

    pub fn cost(&self) -> f64 {
        self.strings.iter().map(|string| string.total).sum()
    }

    /// One step of a string from any point.
    #[inline]
    pub fn next(&self, m: usize, t: usize, point: &Point, request_w: f64) -> Point {
        let (cost, state) = self.problem.step(m, t, point.state, request_w, point.running);
        Point { state, cost: point.cost + cost, running: request_w > 0.0 }
    }

    /// One step of a string from its present path, by the request: what depends on the state alone is computed once.
    pub fn choices(&self, m: usize, t: usize) -> impl Fn(f64) -> Point + '_ {
        let here = *self.at(m, t);
        let c = self.problem.coefficients(m, t, here.state);
        move |request_w| {
            let (cost, state) = self.problem.step_from(|| c, (m, t), here.state, request_w, here.running);
            Point { state, cost: here.cost + cost, running: request_w > 0.0 }
        }
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
        let after = self.next(m, t, self.at(m, t), self.request(m, t));
        self.strings[m].points[t + 1] = after;
    }

    /// The cost of a string with that of its end.
    fn close(&mut self, m: usize) {
        let last = *self.at(m, self.problem.n_steps());
        self.strings[m].total = last.cost + self.problem.end_cost(m, last.state);
    }
}
