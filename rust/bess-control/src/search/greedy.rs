//! The greedy pass: the optimum of each step at the state of the roll-out.

use super::descent::improve;
use super::incremental_rollout::IncrementalRollout;
use super::incumbent::Schedule;
use crate::model::{ControlHorizon, Range, StringState};
use crate::one_step::{solve, CostCurve, OperatingTerms, StringCost};

/// Price of availability loss, relative to the steepest loss, if it must be minimised first.
const SHED_FIRST: f64 = 1e3;
/// Work of one refinement, in roll-outs of the step.
const REFINEMENT: u64 = 2000;

impl ControlHorizon {
    /// Greedy pass. A step without a proven optimum (availability loss, more than two groups, a
    /// non-convex loss table) is refined by the local search on this step alone.
    pub fn greedy(&self) -> Schedule {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let mut states = self.start.clone();
        let mut request_w = vec![0.0; n_strings * n_steps];
        for t in 0..n_steps {
            if self.demand_w[t] > 0.0 {
                let step = self.best_step(t, &states);
                for (m, request) in step.into_iter().enumerate() {
                    request_w[m * n_steps + t] = request;
                }
            }
            for (m, state) in states.iter_mut().enumerate() {
                *state = self.string(m).step(*state, request_w[m * n_steps + t], &self.intervals[t]).end;
            }
        }
        Schedule { objectives: self.objectives(&request_w), request_w }
    }

    fn best_step(&self, t: usize, states: &[StringState]) -> Vec<f64> {
        let loss_group = |g: &usize| (0..self.n_strings()).any(|m| self.costs_of(m)[*g].any_while_running());
        let Some(group) = (0..self.n_groups()).find(loss_group) else {
            return self.refined(t, states, self.proportional(t));
        };
        let mut curves = self.curves(t, states, group);
        let capacity: f64 = curves.iter().map(|c| c.largest_request(true)).sum();
        let sheds = capacity < self.demand_w[t] * (1.0 - 1e-12);
        if sheds {
            let steepest = curves.iter().map(CostCurve::steepest).fold(0.0, f64::max);
            for curve in &mut curves {
                curve.terms.shed_cost = SHED_FIRST * steepest;
            }
        }
        let answer = solve(&curves, self.demand_w[t]);
        let request_w = self.feasible(t, answer.request_w);
        let last = group + 1 == self.n_groups();
        if !sheds && last {
            let costs = IncrementalRollout::new(self, t, states, request_w.clone()).objectives();
            if costs[group] <= answer.bound + 1e-9 * answer.bound.abs() {
                return request_w;
            }
        }
        self.refined(t, states, request_w)
    }

    /// One-step costs at the states, limited to the deliverable power of each string.
    fn curves(&self, t: usize, states: &[StringState], group: usize) -> Vec<CostCurve> {
        let direction = self.direction(t);
        let curve = |m: usize| {
            let string = self.string(m);
            let c = string.coefficients(direction, states[m]);
            let terms = OperatingTerms {
                direction,
                limit_w: self.limit(m, t),
                deliverable_w: string.deliverable_w(&c, direction, states[m].soc, self.intervals[t].dt_h),
                min_power_w: 0.0,
                derating: Range::point(c.derating),
                power_scale_w: Range::point(c.voltage_v * c.voltage_v / c.resistance_ohm),
                scale_price: 0.0,
                power_price: 0.0,
                costs: self.costs_of(m)[group],
                shed_cost: f64::INFINITY,
            };
            CostCurve::new(string.loss(direction), terms)
        };
        (0..self.n_strings()).map(curve).collect()
    }

    fn proportional(&self, t: usize) -> Vec<f64> {
        let limit_w = self.limits(t);
        let share = (self.demand_w[t] / limit_w.iter().sum::<f64>()).min(1.0);
        let mut request_w: Vec<f64> = limit_w.iter().map(|limit_w| limit_w * share).collect();
        self.model.set_points(&mut request_w, &limit_w);
        request_w
    }

    /// Allocates a rounding error or an unallocated remainder to strings with headroom.
    fn feasible(&self, t: usize, mut request_w: Vec<f64>) -> Vec<f64> {
        let mut missing = self.demand_w[t] - request_w.iter().sum::<f64>();
        for (m, request) in request_w.iter_mut().enumerate() {
            // An inverter that is off is not started for a rounding error.
            if *request > 0.0 || missing > 1e-6 * self.demand_w[t] {
                let before = *request;
                *request = (before + missing).clamp(0.0, self.limit(m, t));
                missing -= *request - before;
            }
        }
        self.model.set_points(&mut request_w, &self.limits(t));
        request_w
    }

    fn refined(&self, t: usize, states: &[StringState], request_w: Vec<f64>) -> Vec<f64> {
        let mut tracked = IncrementalRollout::new(self, t, states, request_w);
        improve(&mut tracked, REFINEMENT * self.n_strings() as u64);
        tracked.request_w
    }
}
