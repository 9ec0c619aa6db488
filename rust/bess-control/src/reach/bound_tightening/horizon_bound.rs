//! Lower bound of a horizon over boxes of states: the sum of one-step bounds, each with the value of the state for
//! later steps (docs/equations.md, 9). [`OperatingRanges`] holds the operating ranges of the strings in the boxes, a
//! [`PricedStep`] the curves and the bound of one step, [`HorizonBound`] their sum.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::Direction;

use crate::model::{heat_w, CoefficientRanges, ControlHorizon, Losses, StateBox, StringState};
use crate::one_step::{CostCurve, OneStepSolution, OperatingTerms};
use crate::reach::{step_bound, Cell, Planes, StepBound};

/// Value of the state of a string at a step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StateValues {
    /// Price of `V^2 / R` in the step itself [1/W].
    pub(super) scale_price: f64,
    /// Value of a unit of SOC gained in the step.
    pub(super) charge: f64,
    /// Value of a kelvin of warming by the heat of the step.
    pub(super) warmth: f64,
}

/// One step over boxes, with the values of the state: one entry for each string.
pub(super) struct PricedStep {
    pub(super) values: Vec<StateValues>,
    pub(super) curves: Vec<CostCurve>,
    pub(super) constants: Vec<f64>,
    pub(super) bound: StepBound,
    /// Best price of the demand [1/W].
    pub(super) price: f64,
}

/// Boxes `(M, T + 1)`, and the operating ranges of the strings in them `(M, T)`.
pub(super) struct OperatingRanges<'a> {
    pub(super) horizon: &'a ControlHorizon,
    pub(super) boxes: &'a [StateBox],
    pub(super) ranges: Vec<CoefficientRanges>,
    pub(super) planes: Vec<Planes>,
    pub(super) cells: Vec<Cell>,
}

/// Bounds of all steps over boxes.
pub(super) struct HorizonBound<'a> {
    pub(super) operating: &'a OperatingRanges<'a>,
    pub(super) costs: &'a [Losses],
    /// None without demand.
    pub(super) steps: Vec<Option<PricedStep>>,
    /// Lower bound of the cost of any schedule without availability loss.
    pub(super) bound: f64,
}

impl<'a> OperatingRanges<'a> {
    pub(super) fn new(horizon: &'a ControlHorizon, boxes: &'a [StateBox], near: &[StringState]) -> Self {
        let n_steps = horizon.n_steps();
        let (mut ranges, mut planes, mut cells) = (vec![], vec![], vec![]);
        for m in 0..horizon.n_strings() {
            let string = horizon.string(m);
            for (t, interval) in horizon.intervals.iter().enumerate() {
                let states = &boxes[m * (n_steps + 1) + t];
                ranges.push(string.ranges(interval.direction, states));
                planes.push(string.planes(interval.direction, states, near[m * n_steps + t]));
                cells.push(string.cell(states, &horizon.request_range(m, t), interval));
            }
        }
        Self { horizon, boxes, ranges, planes, cells }
    }

    /// Index of a string and a step in arrays `(M, T)`.
    pub(super) fn at(&self, m: usize, t: usize) -> usize {
        m * self.horizon.n_steps() + t
    }

    /// Remaining share of a temperature difference after a step.
    pub(super) fn retained_share(&self, m: usize, t: usize) -> f64 {
        let dt_s = self.horizon.intervals[t].dt_h * SECONDS_PER_HOUR;
        1.0 - dt_s * self.horizon.string(m).parameters.lumped.k2_per_s
    }

    /// Temperature rise per watt of heat in a step [K/W].
    pub(super) fn kelvin_per_w(&self, m: usize, t: usize) -> f64 {
        let dt_s = self.horizon.intervals[t].dt_h * SECONDS_PER_HOUR;
        dt_s * self.horizon.string(m).parameters.lumped.k1_k_per_j
    }
}

impl<'a> HorizonBound<'a> {
    pub(super) fn new(
        operating: &'a OperatingRanges<'a>,
        costs: &'a [Losses],
        scale_price: &[f64],
        shed_budget_w: f64,
    ) -> Self {
        let horizon = operating.horizon;
        let (n_strings, n_steps) = (horizon.n_strings(), horizon.n_steps());
        let mut horizon_bound = Self { operating, costs, steps: Vec::with_capacity(n_steps), bound: 0.0 };
        let mut values = Vec::with_capacity(n_strings);
        for m in 0..n_strings {
            let (of_string, idle_value) =
                horizon_bound.values(m, &scale_price[m * n_steps..(m + 1) * n_steps]);
            values.push(of_string);
            horizon_bound.bound -= idle_value;
        }
        for t in 0..n_steps {
            let demand_w = horizon.demand_w[t];
            if demand_w <= 0.0 {
                horizon_bound.steps.push(None);
                continue;
            }
            let values: Vec<StateValues> = (0..n_strings).map(|m| values[m][t]).collect();
            let curve = |m: usize| horizon_bound.curve(m, t, &values[m], f64::INFINITY);
            let (mut curves, constants): (Vec<_>, Vec<_>) = (0..n_strings).map(curve).unzip();
            let sheds = (0..n_strings).any(|m| operating.cells[operating.at(m, t)].may_shed());
            let budget_w = if sheds { shed_budget_w } else { 0.0 };
            let (mut bound, OneStepSolution { price, .. }) = step_bound(&mut curves, demand_w, budget_w);
            bound.phi += constants.iter().sum::<f64>();
            horizon_bound.bound += bound.phi;
            horizon_bound.steps.push(Some(PricedStep { values, curves, constants, bound, price }));
        }
        horizon_bound
    }

    /// Values of charge and temperature of a string in each step, by their effect on later `V^2 / R`; and the total value for an
    /// idle string.
    fn values(&self, m: usize, prices: &[f64]) -> (Vec<StateValues>, f64) {
        let (operating, n_steps) = (self.operating, prices.len());
        let planes = &operating.planes[m * n_steps..(m + 1) * n_steps];
        let mut out = vec![StateValues::default(); n_steps];
        let (mut charge, mut warmth) = (0.0, 0.0);
        for t in (0..n_steps).rev() {
            out[t] = StateValues { scale_price: prices[t], charge, warmth };
            charge += prices[t] * planes[t].power_scale_per_soc;
            warmth = operating.retained_share(m, t) * warmth + prices[t] * planes[t].power_scale_per_k;
        }
        let start = operating.horizon.start[m];
        let (mut idle_c, mut idle_value) = (start.temperature_c, 0.0);
        for (t, plane) in planes.iter().enumerate() {
            idle_value += prices[t]
                * (plane.power_scale_w
                    + plane.power_scale_per_soc * start.soc
                    + plane.power_scale_per_k * idle_c);
            let retained = operating.retained_share(m, t);
            idle_c = retained * idle_c + (1.0 - retained) * operating.horizon.intervals[t].ambient_c;
        }
        (out, idle_value)
    }

    /// Cost of a string in a step minus the value of its state change, and a constant.
    pub(super) fn curve(&self, m: usize, t: usize, values: &StateValues, shed_cost: f64) -> (CostCurve, f64) {
        let horizon = self.operating.horizon;
        let string = horizon.string(m);
        let ranges = &self.operating.ranges[self.operating.at(m, t)];
        let direction = horizon.direction(t);
        let limit_w = horizon.limit(m, t);
        let loss = string.loss(direction);
        let v = ranges.voltage_v;
        // Charge per watt of internal power V I, at the end of the voltage range that bounds from below.
        let per_volt = values.charge * horizon.intervals[t].dt_h / string.parameters.capacity_ah;
        let (gained, ends) = match direction {
            Direction::Charge => (per_volt, [v.low, v.high]),
            Direction::Discharge => (-per_volt, [v.high, v.low]),
        };
        let (usual, other) = if values.charge >= 0.0 { (ends[0], ends[1]) } else { (ends[1], ends[0]) };
        let power_price = -gained / usual;
        let mut costs = self.costs[m];
        let mut constant = 0.0;
        // The internal power V I is the power of the inverter plus (discharge) or minus (charge) the heat.
        costs.battery += if direction == Direction::Discharge { power_price } else { -power_price };
        costs.battery -= values.warmth * self.operating.kelvin_per_w(m, t);
        if costs.battery < 0.0 {
            constant += costs.battery * self.operating.cells[self.operating.at(m, t)].heat_w.high;
            costs.battery = 0.0;
        }
        if direction == Direction::Charge && gained != 0.0 {
            // For an inverter that discharges the battery, the other end of the voltage range bounds.
            let lowest = loss.internal_range(0.0, limit_w).low;
            let drawn = -lowest.min(0.0) + heat_w(lowest.min(0.0), ranges.power_scale_w.low, direction);
            constant -= (gained / usual - gained / other).abs() * drawn;
        }
        let terms = OperatingTerms {
            direction,
            limit_w,
            deliverable_w: string.nominal_w(),
            min_power_w: string.min_power_w(),
            derating: ranges.derating,
            power_scale_w: ranges.power_scale_w,
            scale_price: values.scale_price,
            power_price,
            costs,
            shed_cost,
        };
        (CostCurve::new(loss, terms), constant)
    }

    /// Maximum saving by shedding.
    pub(super) fn max_saving(&self, budget_w: f64, cheapest_shed: f64) -> f64 {
        let mut slopes: Vec<_> = (self.steps.iter().zip(&self.operating.horizon.demand_w))
            .filter_map(|(step, demand_w)| Some((step.as_ref()?.bound.shed_slope - cheapest_shed, *demand_w)))
            .filter(|(slope, _)| *slope > 0.0 && slope.is_finite())
            .collect();
        slopes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut left_w = budget_w;
        let mut max_saving = 0.0;
        for (slope, demand_w) in slopes {
            let shed_w = demand_w.min(left_w);
            max_saving += slope * shed_w;
            left_w -= shed_w;
        }
        max_saving
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Range;
    use crate::tests::common;

    const DEMAND_W: f64 = 150e3;
    /// Both strings cost the same.
    const COSTS: Losses = Losses { availability: 0.0, derating: 1e-5, inverter: 1e-5, battery: 1e-5 };

    /// Corners and inner states of a box.
    fn states_in(states: &StateBox) -> Vec<StringState> {
        let shares = [0.0, 0.3, 0.7, 1.0];
        let at = |range: &Range, share: f64| range.low + share * (range.high - range.low);
        let state = |a: f64, b: f64| StringState {
            soc: at(&states.soc, a),
            temperature_c: at(&states.temperature_c, b),
        };
        shares.iter().flat_map(|&a| shares.map(|b| state(a, b))).collect()
    }

    #[test]
    fn at_any_value_of_the_state_no_flow_of_a_string_is_below_its_cost_curve() {
        let mut random = fastrand::Rng::with_seed(5);
        let mut worth_more_than_it_costs = 0;
        for case in 0..40 {
            let sign = if case % 2 == 0 { 1.0 } else { -1.0 };
            let horizon = common::one_objective(2, &[sign * DEMAND_W; 2]);
            let boxes = horizon.reachable();
            let near: Vec<_> = (0..4).map(|i| horizon.start[i / 2]).collect();
            let operating = OperatingRanges::new(&horizon, &boxes, &near);
            let costs = [COSTS; 2];
            let horizon_bound =
                HorizonBound { operating: &operating, costs: &costs, steps: vec![], bound: 0.0 };
            let (m, t) = (0, 1);
            let (string, interval) = (horizon.string(m), &horizon.intervals[t]);
            let mut between = |low: f64, high: f64| low + (high - low) * random.f64();
            let per_charge = COSTS.battery * 700.0 * string.parameters.capacity_ah / interval.dt_h;
            let values = StateValues {
                scale_price: between(0.0, 1.0) * 0.01 * COSTS.battery,
                charge: between(-0.5, 0.5) * per_charge,
                warmth: between(-1.0, 3.0) * COSTS.battery / operating.kelvin_per_w(m, t),
            };
            let (curve, constant) = horizon_bound.curve(m, t, &values, f64::INFINITY);
            worth_more_than_it_costs += usize::from(curve.terms.costs.battery == 0.0);
            let requests = horizon.request_range(m, t);
            for price in [-1.0, 0.0, 0.1, 1.0, 10.0].map(|factor| factor * COSTS.battery) {
                let bound = curve.free(price).value + constant;
                for state in states_in(&boxes[m * 3 + t]) {
                    let c = string.coefficients(interval.direction, state);
                    let scale_w = c.voltage_v * c.voltage_v / c.resistance_ohm;
                    for k in 0..=20 {
                        let share = f64::from(k) / 20.0;
                        let request_w = requests.low + share * (requests.high - requests.low);
                        let flow = string.step(state, request_w, interval);
                        assert_eq!(flow.availability_w, 0.0);
                        let cost = flow.losses().cost(&COSTS) - price * request_w
                            + values.scale_price * scale_w
                            - values.charge * (flow.end.soc - state.soc)
                            - values.warmth * operating.kelvin_per_w(m, t) * flow.battery_w;
                        assert!(cost >= bound - 1e-9 * bound.abs(), "{cost} below {bound}");
                    }
                }
            }
        }
        assert!(worth_more_than_it_costs >= 10);
    }
}
