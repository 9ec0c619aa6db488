//! Initial schedules: all rules, and the shifted warm start.

use bess_tables::Direction;

use crate::model::StringState;
use crate::plan::paths::Paths;
use crate::plan::problem::PlanProblem;

/// Relative remainder of an allocated power that counts as rounding and switches no inverter on.
pub(crate) const CRUMBS: f64 = 1e-9;

/// Rule for the power of a step without forecast. The first four are the policies of these names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Equal power in every string.
    Equal,
    /// In proportion to stored charge or headroom.
    Soc,
    /// In proportion to nominal power and the distance from the temperature of full derating.
    Temperature,
    /// Strings in fixed order.
    Priority,
    /// Strings in rotating order, with another first string in every step.
    Rotation,
}

impl Rule {
    /// All rules.
    pub const ALL: [Self; 5] = [Self::Equal, Self::Soc, Self::Temperature, Self::Priority, Self::Rotation];

    /// Schedule of a rule over all steps.
    pub(crate) fn paths<'a>(self, problem: &'a PlanProblem<'a>) -> Paths<'a> {
        Paths::shared(problem, |t, states| self.share(problem, t, states))
    }

    /// Powers of one step. Demand above the total capability is requested within the free inverter power.
    fn share(self, problem: &PlanProblem<'_>, t: usize, states: &[StringState]) -> Vec<f64> {
        let demand_w = problem.demand_w[t];
        if demand_w == 0.0 {
            return vec![0.0; states.len()];
        }
        let limit_w = &problem.limit_w;
        let caps = deliverable_w(problem, t, states);
        let mut power = match self {
            Self::Priority => in_turn(demand_w, &caps, 0),
            Self::Rotation => in_turn(demand_w, &caps, t),
            _ => water_fill(demand_w, &self.weights(problem, t, states), &caps),
        };
        let rest: f64 = demand_w - power.iter().sum::<f64>();
        if rest > CRUMBS * demand_w {
            let free: Vec<f64> = limit_w.iter().zip(&power).map(|(l, p)| (l - p).max(0.0)).collect();
            for (m, more) in water_fill(rest, &free, &free).into_iter().enumerate() {
                power[m] = (power[m] + more).min(limit_w[m]);
            }
        }
        power
    }

    /// Weights of the rule.
    fn weights(self, problem: &PlanProblem<'_>, t: usize, states: &[StringState]) -> Vec<f64> {
        let weight = |(m, state): (usize, &StringState)| {
            let string = &problem.model.strings()[m];
            let p = &string.parameters;
            match (self, problem.intervals[t].direction) {
                (Self::Soc, Direction::Charge) => p.capacity_ah * (p.soc_max - state.soc).max(0.0),
                (Self::Soc, Direction::Discharge) => p.capacity_ah * (state.soc - p.soc_min).max(0.0),
                (Self::Temperature, _) => {
                    let stop_c = p.derating.factor.x().last().copied().unwrap_or(f64::INFINITY);
                    string.nominal_w() * (stop_c - state.temperature_c).max(0.0)
                }
                _ => 1.0,
            }
        };
        states.iter().enumerate().map(weight).collect()
    }
}

/// Maximum deliverable power of each string in a step, within its limit [W].
pub(crate) fn deliverable_w(problem: &PlanProblem<'_>, t: usize, states: &[StringState]) -> Vec<f64> {
    let interval = &problem.intervals[t];
    let cap = |(m, state): (usize, &StringState)| {
        let string = &problem.model.strings()[m];
        let c = string.coefficients(interval.direction, *state);
        let curve = problem.curve(m, t);
        string
            .deliverable_with(curve, &c, interval.direction, state.soc, interval.dt_h)
            .min(problem.limit_w[m])
    };
    states.iter().enumerate().map(cap).collect()
}

/// Fills the strings in order, starting with `first` [W].
fn in_turn(total_w: f64, caps_w: &[f64], first: usize) -> Vec<f64> {
    let n = caps_w.len();
    let mut power = vec![0.0; n];
    let mut rest = total_w;
    for m in (0..n).map(|k| (first + k) % n) {
        power[m] = rest.min(caps_w[m]);
        rest -= power[m];
        if rest <= CRUMBS * total_w {
            break;
        }
    }
    power
}

/// Allocates `total_w` in proportion to weights; power above a cap goes to the others. Strings without weight get power
/// only if all others are at their caps.
pub(crate) fn water_fill(total_w: f64, weights: &[f64], caps_w: &[f64]) -> Vec<f64> {
    let n = caps_w.len();
    let mut power = vec![0.0; n];
    let mut open: Vec<bool> = caps_w.iter().map(|&cap| cap > 0.0).collect();
    let mut rest = total_w;
    while rest > 0.0 && open.contains(&true) {
        let among = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&open).map(|(&v, &o)| if o { v } else { 0.0 }).collect()
        };
        let mut share = among(weights);
        if share.iter().sum::<f64>() <= 0.0 {
            share = among(caps_w);
        }
        let whole: f64 = share.iter().sum();
        let wanted: Vec<f64> = (0..n).map(|m| power[m] + rest * (share[m] / whole)).collect();
        let over: Vec<bool> = (0..n).map(|m| open[m] && wanted[m] >= caps_w[m]).collect();
        if !over.contains(&true) {
            return wanted;
        }
        for m in 0..n {
            if over[m] {
                power[m] = caps_w[m];
                open[m] = false;
            }
        }
        rest = total_w - power.iter().sum::<f64>();
    }
    power
}

/// The requests `(M, T)` [W] of an earlier plan, adapted to demand and limits: excess power goes first to strings that
/// are on, in proportion to their headroom, then to the others.
pub(crate) fn carried_on(problem: &PlanProblem<'_>, request_w: &[f64]) -> Vec<f64> {
    let (n_strings, n_steps) = (problem.n_strings(), problem.n_steps());
    let mut out = vec![0.0; request_w.len()];
    for t in 0..n_steps {
        let demand = problem.demand_w[t];
        let mut power: Vec<f64> =
            (0..n_strings).map(|m| request_w[m * n_steps + t].clamp(0.0, problem.limit_w[m])).collect();
        let sum: f64 = power.iter().sum();
        if sum > demand {
            power.iter_mut().for_each(|p| *p *= demand / sum);
        }
        for running in [true, false] {
            let rest = demand - power.iter().sum::<f64>();
            if rest <= CRUMBS * demand {
                break;
            }
            let room =
                |m: usize| if (power[m] > 0.0) == running { problem.limit_w[m] - power[m] } else { 0.0 };
            let rooms: Vec<f64> = (0..n_strings).map(room).collect();
            for (p, more) in power.iter_mut().zip(water_fill(rest, &rooms, &rooms)) {
                *p += more;
            }
        }
        for (m, p) in power.into_iter().enumerate() {
            out[m * n_steps + t] = p;
        }
    }
    out
}
