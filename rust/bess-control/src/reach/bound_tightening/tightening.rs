//! Optimality-based bound tightening: schedules that cost no more than a reference exceed the bound by at most the slack
//! between the two, which limits the deviation of charge and temperature of each string (docs/equations.md, 10).
//! This is a knapsack over the steps, bounded by rewarding the deviation of the string.

use bess_tables::Direction;

use super::horizon_bound::{HorizonBound, PricedStep};
use crate::model::{Range, StateBox};
use crate::one_step::CostCurve;

/// Safety margin for the rounding of states.
const SOC_ROUNDING: f64 = 1e-9;
const TEMPERATURE_ROUNDING_K: f64 = 1e-6;
/// Rewards of the power of a string, in mean prices of the demand.
const POWER_REWARDS: [f64; 4] = [0.03, 0.1, 0.3, 1.0];
/// Rewards of its temperature rise, in costs of the heat.
const HEAT_REWARDS: [f64; 4] = [0.1, 0.25, 0.5, 0.8];
const N_REWARDS: usize = POWER_REWARDS.len();

/// Quantity of a string to be bounded from above.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Target {
    /// SOC gained, times the sign.
    Charge(f64),
    /// Warming by its own heat, times the sign.
    Warmth(f64),
}

/// The Lagrangian of a step at a price of the demand: its value, and the part of each string.
struct DualByString {
    price: f64,
    bound: f64,
    parts: Vec<f64>,
}

/// Duals of a step at its best price, and at likely lower and higher prices with a rewarded string.
struct StepDuals<'a> {
    step: &'a PricedStep,
    best: DualByString,
    below: Vec<DualByString>,
    above: Vec<DualByString>,
}

/// A bounded horizon, and the ranges of schedules within a slack of its bound.
pub(super) struct Tightening<'a> {
    horizon_bound: &'a HorizonBound<'a>,
    slack: f64,
    mean_price: f64,
    /// None where there is no demand.
    duals: Vec<Option<StepDuals<'a>>>,
}

impl<'a> Tightening<'a> {
    pub(super) fn new(horizon_bound: &'a HorizonBound<'a>, slack: f64) -> Self {
        let demand_w = &horizon_bound.operating.horizon.demand_w;
        let priced = || horizon_bound.steps.iter().flatten();
        let mean_price = priced().map(|step| step.price.abs()).sum::<f64>() / priced().count().max(1) as f64;
        let duals = |(step, demand_w): (&'a Option<PricedStep>, &f64)| {
            let step = step.as_ref()?;
            let PricedStep { curves, constants, price, .. } = step;
            let at = |price: f64| DualByString::new(curves, constants, *demand_w, price);
            let n_on = curves.iter().filter(|c| c.free(*price).request_w > 0.0).count().max(1) as f64;
            let shifted =
                |sign: f64| POWER_REWARDS.iter().map(|r| at(price + sign * r * mean_price / n_on)).collect();
            Some(StepDuals { step, best: at(*price), below: shifted(-1.0), above: shifted(1.0) })
        };
        let duals = horizon_bound.steps.iter().zip(demand_w).map(duals).collect();
        Self { horizon_bound, slack, mean_price, duals }
    }

    /// Tightened boxes, or None if one is empty.
    pub(super) fn tightened(&self) -> Option<Vec<StateBox>> {
        let rows = (0..self.horizon_bound.operating.horizon.n_strings()).map(|m| self.tightened_string(m));
        rows.collect::<Option<Vec<_>>>().map(|rows| rows.concat())
    }

    fn tightened_string(&self, m: usize) -> Option<Vec<StateBox>> {
        let operating = self.horizon_bound.operating;
        let horizon = operating.horizon;
        let row = &operating.boxes[m * (horizon.n_steps() + 1)..(m + 1) * (horizon.n_steps() + 1)];
        let [gained, lost] = [1.0, -1.0].map(|sign| self.most(m, Target::Charge(sign)));
        let [warmed, cool] = [1.0, -1.0].map(|sign| self.most(m, Target::Warmth(sign)));
        let start = horizon.start[m];
        let (mut unheated_c, mut kept) = (start.temperature_c, 1.0);
        let mut out = vec![row[0]];
        for (t, interval) in horizon.intervals.iter().enumerate() {
            let retained = operating.retained_share(m, t);
            unheated_c = retained * unheated_c + (1.0 - retained) * interval.ambient_c;
            let reached = horizon.string(m).cell(&out[t], &horizon.request_range(m, t), interval).end;
            let mut now = row[t + 1].intersection(&reached);
            now.soc.low = now.soc.low.max(start.soc - lost[t + 1] - SOC_ROUNDING);
            now.soc.high = now.soc.high.min(start.soc + gained[t + 1] + SOC_ROUNDING);
            if retained > 0.0 {
                // Heat decays: its full amount is an upper bound, the remainder of the oldest heat a lower bound.
                let low = unheated_c - kept * cool[t + 1] - TEMPERATURE_ROUNDING_K;
                let high = unheated_c + warmed[t + 1] + TEMPERATURE_ROUNDING_K;
                now.temperature_c = now.temperature_c.intersection(&Range { low, high });
                kept *= retained;
            }
            if now.is_empty() {
                return None;
            }
            out.push(now);
        }
        Some(out)
    }

    /// Upper bounds `(T + 1,)` of the accumulated target at each step boundary.
    fn most(&self, m: usize, target: Target) -> Vec<f64> {
        let n_steps = self.duals.len();
        let alone: Vec<Range> = (0..n_steps).map(|t| self.of_step(m, t, target)).collect();
        let mut best = vec![0.0; n_steps + 1];
        for t in 0..n_steps {
            best[t + 1] = best[t] + alone[t].high;
        }
        let width: f64 = alone.iter().map(Range::width).sum();
        for level in 0..N_REWARDS {
            let per_unit = self.per_unit(m, level, target);
            if self.slack >= per_unit * width {
                continue;
            }
            let mut sum = self.slack / per_unit;
            for t in 0..n_steps {
                let with_slack = self.duals[t].as_ref().map_or(f64::INFINITY, |duals| {
                    (duals.step.bound.phi - self.rewarded(duals, (m, t), target, level, per_unit)) / per_unit
                });
                sum += with_slack.min(alone[t].high);
                best[t + 1] = best[t + 1].min(sum);
            }
        }
        best
    }

    /// Maximum increase of the target in one step at any cost.
    fn of_step(&self, m: usize, t: usize, target: Target) -> Range {
        let operating = self.horizon_bound.operating;
        let (horizon, cell) = (operating.horizon, &operating.cells[operating.at(m, t)]);
        let (range, factor) = match target {
            Target::Charge(sign) => {
                let per_ampere = horizon.intervals[t].dt_h / horizon.string(m).parameters.capacity_ah;
                (cell.current_a, -horizon.direction(t).sign() * sign * per_ampere)
            }
            Target::Warmth(sign) => (cell.heat_w, sign * operating.kelvin_per_w(m, t)),
        };
        [factor * range.low, factor * range.high].into_iter().collect()
    }

    /// A reward of the target, in costs per unit of it.
    fn per_unit(&self, m: usize, level: usize, target: Target) -> f64 {
        let horizon = self.horizon_bound.operating.horizon;
        match target {
            Target::Charge(_) => {
                let p = &horizon.string(m).parameters;
                let v = p.ocv(Direction::Discharge, 0.5, 25.0);
                POWER_REWARDS[level] * self.mean_price * v * p.capacity_ah / horizon.intervals[0].dt_h
            }
            Target::Warmth(_) => {
                HEAT_REWARDS[level] * self.horizon_bound.costs[m].battery
                    / self.horizon_bound.operating.kelvin_per_w(m, 0)
            }
        }
    }

    /// Lower bound of a step's cost minus the reward of string `m` for the target.
    fn rewarded(
        &self,
        duals: &StepDuals<'_>,
        (m, t): (usize, usize),
        target: Target,
        level: usize,
        per_unit: f64,
    ) -> f64 {
        let mut values = duals.step.values[m];
        let eager = match target {
            Target::Charge(sign) => {
                values.charge += sign * per_unit;
                (sign > 0.0) == (self.horizon_bound.operating.horizon.direction(t) == Direction::Charge)
            }
            Target::Warmth(sign) => {
                values.warmth += sign * per_unit;
                sign > 0.0
            }
        };
        let (curve, constant) = self.horizon_bound.curve(m, t, &values, duals.step.curves[m].terms.shed_cost);
        // A string rewarded for power lowers the price of the demand; a string rewarded against power raises it.
        let shifted = if eager { &duals.below[level] } else { &duals.above[level] };
        let bound = |at: &DualByString| at.bound - at.parts[m] + curve.free(at.price).value + constant;
        bound(&duals.best).max(bound(shifted))
    }
}

impl DualByString {
    fn new(curves: &[CostCurve], constants: &[f64], demand_w: f64, price: f64) -> Self {
        let part = |(curve, constant): (&CostCurve, &f64)| curve.free(price).value + constant;
        let parts: Vec<f64> = curves.iter().zip(constants).map(part).collect();
        Self { price, bound: price * demand_w + parts.iter().sum::<f64>(), parts }
    }
}
