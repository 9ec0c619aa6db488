//! The greedy pass: the optimum of each step at the state of the roll-out.

use super::descent::improve;
use super::incremental_rollout::IncrementalRollout;
use super::incumbent::Schedule;
use crate::model::{ControlHorizon, CostsOf, StringState};
use crate::one_step::{solve, CostCurve, StringCost};

/// Price of availability loss, relative to the steepest loss, if it must be minimised first.
const SHED_FIRST: f64 = 1e3;
/// Work of one refinement, in roll-outs of the step.
const REFINEMENT: u64 = 2000;

impl ControlHorizon {
    /// Greedy pass. A step without a proven optimum (availability loss, more than two groups, a
    /// non-convex loss table) is refined by the local search on this step alone.
    pub fn greedy(&self) -> Schedule {
        let n_steps = self.n_steps();
        let mut states = self.start.clone();
        let mut request_w = vec![0.0; self.size()];
        for t in 0..n_steps {
            let step = self.single_step(t, states);
            let best_w = if self.demand_w[t] > 0.0 { step.best_step() } else { vec![0.0; self.n_strings()] };
            for (m, &request) in best_w.iter().enumerate() {
                request_w[m * n_steps + t] = request;
            }
            states = step.flows(&best_w).iter().map(|flow| flow.end).collect();
        }
        self.rated(request_w)
    }

    /// The problem of one step alone, from these states.
    fn single_step(&self, t: usize, start: Vec<StringState>) -> Self {
        Self {
            start,
            demand_w: vec![self.demand_w[t]],
            intervals: vec![self.intervals[t]],
            limit_w: self.limits(t),
            total_limit_w: vec![self.total_limit_w[t]],
            ..self.clone()
        }
    }

    /// Requests `(M,)` [W] of a problem of one step.
    fn best_step(&self) -> Vec<f64> {
        let loss_group = |g: &usize| (0..self.n_strings()).any(|m| self.costs_of(m)[*g].any_while_running());
        let Some(group) = (0..self.n_groups()).find(loss_group) else {
            return self.refined(self.fitted(&self.limit_w));
        };
        let (costs, interval) = (self.group_costs(group, CostsOf::Search), &self.intervals[0]);
        let deliverable_w = self.model.deliverable_w(&self.start, interval.direction, interval.dt_h);
        let most = |m: usize| (self.limit_w[m], deliverable_w[m], 0.0);
        let mut curves = self.curves(0, |m| self.start[m].into(), &costs, most);
        let capacity: f64 = curves.iter().map(|c| c.largest_request(true)).sum();
        let sheds = capacity < self.demand_w[0] * (1.0 - 1e-12);
        if sheds {
            let steepest = curves.iter().map(CostCurve::steepest).fold(0.0, f64::max);
            for curve in &mut curves {
                curve.terms.shed_cost = SHED_FIRST * steepest;
            }
        }
        let answer = solve(&curves, self.demand_w[0]);
        let request_w = self.feasible(answer.request_w);
        let last = group + 1 == self.n_groups();
        if !sheds && last {
            let cost = self.objectives(&request_w)[group];
            if cost <= answer.bound + 1e-9 * answer.bound.abs() {
                return request_w;
            }
        }
        self.refined(request_w)
    }

    /// Allocates a rounding error or an unallocated remainder to strings with headroom.
    fn feasible(&self, mut request_w: Vec<f64>) -> Vec<f64> {
        let mut missing = self.demand_w[0] - request_w.iter().sum::<f64>();
        for (request, &limit_w) in request_w.iter_mut().zip(&self.limit_w) {
            // An inverter that is off is not started for a rounding error.
            if *request > 0.0 || missing > 1e-6 * self.demand_w[0] {
                let before = *request;
                *request = (before + missing).clamp(0.0, limit_w);
                missing -= *request - before;
            }
        }
        self.model.set_points(&mut request_w, &self.limit_w);
        request_w
    }

    fn refined(&self, request_w: Vec<f64>) -> Vec<f64> {
        let mut tracked = IncrementalRollout::new(self, request_w);
        improve(&mut tracked, REFINEMENT * self.n_strings() as u64);
        tracked.request_w
    }
}
