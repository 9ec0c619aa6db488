//! Initial schedules: all rules, and the shifted warm start.

use crate::plan::paths::Paths;
use crate::plan::problem::{PlanProblem, Point};
use crate::rules::{water_fill, Rule};

/// Relative rest of an allocated power that is rounding and switches no inverter on.
pub(crate) const ROUNDING_SHARE: f64 = 1e-9;

pub(crate) fn rule_schedule<'a>(rule: Rule, problem: &'a PlanProblem<'a>) -> Paths<'a> {
    Paths::from_policy(problem, |t, points| powers(rule, problem, t, points))
}

/// Powers of one step. Demand above the total capability is requested within the free inverter power.
fn powers(rule: Rule, problem: &PlanProblem<'_>, t: usize, points: &[Point]) -> Vec<f64> {
    let demand_w = problem.demand_w[t];
    if demand_w == 0.0 {
        return vec![0.0; points.len()];
    }
    let strings = problem.model.strings();
    let usable = |m: usize| {
        let p = &strings[m].parameters;
        let soc = points[m].state.soc;
        p.capacity_ah * problem.intervals[t].direction.pick(p.soc_max - soc, soc - p.soc_min).max(0.0)
    };
    let margin = |m: usize| {
        let full_derating_c =
            strings[m].parameters.derating.factor.x().last().copied().unwrap_or(f64::INFINITY);
        strings[m].nominal_w() * (full_derating_c - points[m].state.temperature_c).max(0.0)
    };
    let caps = deliverable_w(problem, t, points);
    rule.allocate(demand_w, (&caps, problem.limits_w(t)), usable, margin, t, ROUNDING_SHARE)
}

/// Maximum deliverable power of each string in a step, within its limit [W].
pub(crate) fn deliverable_w(problem: &PlanProblem<'_>, t: usize, points: &[Point]) -> Vec<f64> {
    let interval = &problem.intervals[t];
    let cap = |(m, &Point { state, .. }): (usize, &Point)| {
        let string = &problem.model.strings()[m];
        let c = string.coefficients(interval.direction, state);
        let curve = problem.curve(m, t);
        string
            .deliverable_with(curve, &c, interval.direction, state.soc, interval.dt_h)
            .min(problem.limit_w(m, t))
    };
    points.iter().enumerate().map(cap).collect()
}

/// The requests `(M, T)` [W] of an earlier plan, adapted to demand and limits.
pub(crate) fn fit_to_problem(problem: &PlanProblem<'_>, request_w: &[f64]) -> Vec<f64> {
    let (n_strings, n_steps) = (problem.n_strings(), problem.n_steps());
    let mut out = vec![0.0; request_w.len()];
    for t in 0..n_steps {
        let demand = problem.demand_w[t];
        let mut power: Vec<f64> =
            (0..n_strings).map(|m| request_w[m * n_steps + t].clamp(0.0, problem.limit_w(m, t))).collect();
        let sum: f64 = power.iter().sum();
        if sum > demand {
            power.iter_mut().for_each(|p| *p *= demand / sum);
        }
        allocate_remainder(&mut power, demand, problem.limits_w(t));
        for (m, p) in power.into_iter().enumerate() {
            out[m * n_steps + t] = p;
        }
    }
    out
}

/// Allocates the remaining demand: first to strings that are on, in proportion to their headroom, then to the others.
pub(crate) fn allocate_remainder(power: &mut [f64], demand_w: f64, limit_w: &[f64]) {
    for running in [true, false] {
        let rest = demand_w - power.iter().sum::<f64>();
        if rest <= ROUNDING_SHARE * demand_w {
            return;
        }
        let headroom = |m: usize| if (power[m] > 0.0) == running { limit_w[m] - power[m] } else { 0.0 };
        let headrooms: Vec<f64> = (0..power.len()).map(headroom).collect();
        for (p, more) in power.iter_mut().zip(water_fill(rest, &headrooms, &headrooms)) {
            *p += more;
        }
    }
}
