//! Data of a plan: strings, measured state, demand, limits, surroundings, prices.

use std::ops;

use bess_tables::{Direction, InputError};

use crate::error::{check_length, check_range};
use crate::model::{
    Coefficients, CoefficientsFrom, ControlModel, Flow, Interval, LossCurve, Losses, Range, StringState,
    TEMPERATURE_RANGE_C,
};
use crate::reactive::curve_at_power_factor;

/// Price of undelivered energy in the relaxation of a proof, relative to that of losses: a few times the marginal loss of a
/// delivered kWh. 0.1 to 0.3 give similar bounds.
const RELAXED_SHED_PRICE: f64 = 0.2;
/// Margin of a grid above the hottest string without derating [K].
const GRID_MARGIN_K: f64 = 35.0;

/// Prices of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Prices {
    /// Price of losses in each step `(T,)` [cost/Wh]. The unit of cost is that of the objective: kWh or EUR.
    pub losses: Vec<Losses>,
    /// Price of charge throughput, in either direction `(M,)` [cost/Ah].
    pub wear: Vec<f64>,
    /// Price of an inverter start [cost].
    pub start: f64,
    /// Price of SOC differences: squared distance of a string's fill from that of the plant [cost per Ah of capacity and hour].
    pub balance: f64,
    /// Price of final charge [cost/Ah]; negative, because stored charge has a value.
    pub end_charge: f64,
}

/// A string at the start of a step: state, accumulated cost, and whether its inverter delivered power in the previous step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub state: StringState,
    pub cost: f64,
    pub running: bool,
}

/// One plan's data. Arrays over strings and steps are string-major, `(M, T)`; requests are magnitudes in the direction of
/// their step.
#[derive(Debug, Clone)]
pub struct PlanProblem<'a> {
    pub(crate) model: &'a ControlModel,
    /// Measured states `(M,)`.
    pub(crate) start: Vec<StringState>,
    /// Whether each inverter is on before the first step `(M,)`.
    pub(crate) running: Vec<bool>,
    /// Magnitudes `(T,)` [W], at most the sum of the limits.
    pub(crate) demand_w: Vec<f64>,
    /// Direction, surroundings and length of each step `(T,)`.
    pub(crate) intervals: Vec<Interval>,
    /// Maximum requests `(T, M)` [W]: one step after the other.
    limit_w: Vec<f64>,
    pub(crate) prices: Prices,
    coefficients_from: CoefficientsFrom,
    /// Fill of the plant at the end of each step `(T,)`, the reference of SOC differences.
    pub(crate) fill: Vec<f64>,
    /// Price of the squared SOC difference of each string in each step `(M, T)` [cost/h]; falls while the plant will be neither
    /// nearly empty nor nearly full.
    pub(crate) imbalance: Vec<f64>,
    /// Reactive power demand, magnitudes `(T,)` [var]; empty without one.
    pub(crate) reactive_var: Vec<f64>,
    /// Losses of each kind of inverter with the reactive power of each step `(K, T)`; empty without reactive power.
    curves: Vec<LossCurve>,
    /// Kind of each inverter `(M,)`; empty without reactive power.
    inverters: Vec<usize>,
}

/// Groups items of the same kind.
pub(crate) fn kinds(
    items: impl IntoIterator<Item = usize>,
    same_kind: impl Fn(usize, usize) -> bool,
) -> Vec<Vec<usize>> {
    let mut kinds: Vec<Vec<usize>> = vec![];
    for item in items {
        match kinds.iter_mut().find(|kind| same_kind(kind[0], item)) {
            Some(kind) => kind.push(item),
            None => kinds.push(vec![item]),
        }
    }
    kinds
}

/// The kind of each of `n` items, 0 for those of no kind.
pub(crate) fn kind_indices(kinds: &[Vec<usize>], n: usize) -> Vec<usize> {
    let mut of_each = vec![0; n];
    for (kind, items) in kinds.iter().enumerate() {
        items.iter().for_each(|&item| of_each[item] = kind);
    }
    of_each
}

impl<'a> PlanProblem<'a> {
    /// Checks a problem.
    ///
    /// `start` and `running` `(M,)`: measured states, and whether each inverter is on. `demand_w` `(T,)` has no sign, which is
    /// in `intervals`; demand above the sum of the limits `limit_w` `(M, T)` of a step is ignored.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, or a number is not finite or negative.
    pub fn new(
        model: &'a ControlModel,
        start: Vec<StringState>,
        running: Vec<bool>,
        demand_w: &[f64],
        intervals: Vec<Interval>,
        limit_w: &[f64],
        prices: Prices,
    ) -> Result<Self, InputError> {
        let (n_strings, n_steps) = (model.strings().len(), demand_w.len());
        check_length("start", &start, n_strings)?;
        check_length("running", &running, n_strings)?;
        check_length("limit", limit_w, n_strings * n_steps)?;
        check_length("intervals", &intervals, n_steps)?;
        check_length("prices of losses", &prices.losses, n_steps)?;
        check_length("wear", &prices.wear, n_strings)?;
        check_range("demand", demand_w, (0.0, f64::MAX), " W")?;
        for interval in &intervals {
            check_range("dt_h", &[interval.dt_h], (f64::MIN_POSITIVE, f64::MAX), " h")?;
            check_range("ambient_c", &[interval.ambient_c], TEMPERATURE_RANGE_C, " degC")?;
        }
        check_range("wear", &prices.wear, (0.0, f64::MAX), "")?;
        for p in &prices.losses {
            check_range("prices of losses", &p.to_array(), (0.0, f64::MAX), "")?;
        }
        check_range("start and balance", &[prices.start, prices.balance], (0.0, f64::MAX), "")?;
        check_range("end_charge", &[prices.end_charge], (-f64::MAX, f64::MAX), "")?;
        for (m, string) in model.strings().iter().enumerate() {
            let row = &limit_w[m * n_steps..(m + 1) * n_steps];
            check_range("limit", row, (0.0, string.nominal_w() * (1.0 + 1e-9)), " W")?;
        }
        let limit_w: Vec<f64> =
            (0..n_steps).flat_map(|t| (0..n_strings).map(move |m| limit_w[m * n_steps + t])).collect();
        let total = |t: usize| limit_w[t * n_strings..(t + 1) * n_strings].iter().sum();
        let demand_w = demand_w.iter().enumerate().map(|(t, d)| d.min(total(t))).collect();
        let (fill, imbalance) = (vec![0.0; n_steps], vec![0.0; n_strings * n_steps]);
        Ok(Self {
            model,
            start,
            running,
            demand_w,
            intervals,
            limit_w,
            prices,
            coefficients_from: CoefficientsFrom::Middle,
            fill,
            imbalance,
            reactive_var: vec![],
            curves: vec![],
            inverters: vec![],
        })
    }

    pub(crate) fn with_coefficients_from(mut self, coefficients_from: CoefficientsFrom) -> Self {
        self.coefficients_from = coefficients_from;
        self
    }

    /// Adds a reactive power demand, magnitudes `(T,)` [var]; reactive power above the remaining inverter power is excluded.
    ///
    /// In a plan, every string carries reactive power in proportion to its active power, and an overload uses
    /// another identical inverter: losses follow the power factor of the plant. Allocation by [`ControlModel::share_reactive`]
    /// has no higher losses, unless there is no such other inverter.
    ///
    /// # Errors
    ///
    /// The length differs from that of the demand, or a number is not finite or negative.
    pub fn with_reactive(mut self, reactive_var: &[f64]) -> Result<Self, InputError> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        check_length("reactive power", reactive_var, n_steps)?;
        check_range("reactive power", reactive_var, (0.0, f64::MAX), " var")?;
        let factor = |t: usize| {
            let (p, total) = (self.demand_w[t], self.limits_w(t).iter().sum());
            if p > 0.0 {
                p.hypot(reactive_var[t]).min(total).max(p) / p
            } else {
                1.0
            }
        };
        let factors: Vec<f64> = (0..n_steps).map(factor).collect();
        let strings = self.model.strings();
        let of_inverter =
            |a: usize, b: usize| strings[a].parameters.inverter == strings[b].parameters.inverter;
        let kinds = kinds(0..n_strings, of_inverter);
        self.inverters = kind_indices(&kinds, n_strings);
        for kind in kinds {
            for (t, &factor) in factors.iter().enumerate() {
                let curve = strings[kind[0]].loss(self.intervals[t].direction);
                let nominal_w = strings[kind[0]].nominal_w();
                self.curves.push(curve_at_power_factor(curve, nominal_w, factor, self.demand_w[t]));
            }
        }
        self.reactive_var = reactive_var.to_vec();
        Ok(self)
    }

    /// The problem in steps `per` times as long: mean demand, ambient temperature, limits and prices of each `per` steps, and the
    /// loss curves of the first of them. A last step beyond the horizon has the energy of the steps within.
    pub(crate) fn coarsened(&self, per: usize) -> Self {
        let n_steps = self.n_steps();
        let blocks: Vec<_> = (0..n_steps).step_by(per).map(|from| from..(from + per).min(n_steps)).collect();
        let mean = |block: &ops::Range<usize>, of: &dyn Fn(usize) -> f64| {
            block.clone().map(of).sum::<f64>() / block.len() as f64
        };
        let signed_w = |t: usize| self.intervals[t].direction.sign() * self.demand_w[t];
        let mut coarse = self.clone();
        coarse.demand_w =
            blocks.iter().map(|b| (b.clone().map(signed_w).sum::<f64>() / per as f64).abs()).collect();
        coarse.intervals = blocks
            .iter()
            .map(|b| Interval {
                direction: Direction::of(mean(b, &signed_w)),
                ambient_c: mean(b, &|t| self.intervals[t].ambient_c),
                dt_h: self.intervals[b.start].dt_h * per as f64,
            })
            .collect();
        let price = |b: &ops::Range<usize>, kind: usize| mean(b, &|t| self.prices.losses[t].to_array()[kind]);
        coarse.prices.losses =
            blocks.iter().map(|b| Losses::from_array([0, 1, 2, 3].map(|kind| price(b, kind)))).collect();
        let limit_w = |b: &ops::Range<usize>, m: usize| mean(b, &|t| self.limit_w(m, t));
        coarse.limit_w =
            blocks.iter().flat_map(|b| (0..self.n_strings()).map(move |m| limit_w(b, m))).collect();
        coarse.prices.balance = 0.0;
        if !self.curves.is_empty() {
            let of_kind = |row: &[LossCurve]| -> Vec<LossCurve> {
                blocks.iter().map(|b| row[b.start].clone()).collect()
            };
            coarse.curves = self.curves.chunks_exact(n_steps).flat_map(of_kind).collect();
        }
        coarse
    }

    /// The problem of a sample of at most `n` strings in service, drawn evenly from each kind in order of SOC, with a demand in
    /// proportion to their limits; and this proportion.
    pub(crate) fn sampled(&self, n: usize) -> (Self, f64) {
        let mut strings: Vec<usize> = vec![];
        for mut kind in self.kinds() {
            kind.sort_by(|&a, &b| self.start[a].soc.total_cmp(&self.start[b].soc));
            strings.extend(kind);
        }
        let mut sample = self.clone();
        if strings.len() <= n {
            return (sample, 1.0);
        }
        sample.limit_w.fill(0.0);
        for m in (0..n).map(|k| strings[(2 * k + 1) * strings.len() / (2 * n)]) {
            for t in 0..self.n_steps() {
                sample.limit_w[t * self.n_strings() + m] = self.limit_w(m, t);
            }
        }
        let share = |sampled: &[f64], all: &[f64]| match all.iter().sum::<f64>() {
            0.0 => 0.0,
            total => sampled.iter().sum::<f64>() / total,
        };
        for (t, demand_w) in sample.demand_w.iter_mut().enumerate() {
            *demand_w *= share(&sample.limit_w[t * self.n_strings()..][..self.n_strings()], self.limits_w(t));
        }
        let share = share(&sample.limit_w, &self.limit_w);
        (sample, share)
    }

    /// Length of the steps [h], equal in dynamic programs.
    pub(crate) fn dt_h(&self) -> f64 {
        self.intervals[0].dt_h
    }

    /// Usable SOC window of a string.
    pub(crate) fn soc_window(&self, m: usize) -> Range {
        let (low, high) = self.model.strings()[m].soc_window();
        Range { low, high }
    }

    /// Number of steps in at most about `hours`, at least one, that divides the horizon as evenly as possible.
    pub(crate) fn steps_of(&self, hours: f64) -> usize {
        let n_steps = self.n_steps();
        let most = self.intervals.first().map_or(1, |i| ((hours / i.dt_h).round() as usize).max(1));
        n_steps.div_ceil(n_steps.div_ceil(most).max(1)).max(1)
    }

    /// Whether two strings are equal except for their states.
    pub(crate) fn same_kind(&self, a: usize, b: usize) -> bool {
        a == b
            || ((0..self.n_steps()).all(|t| self.limit_w(a, t) == self.limit_w(b, t))
                && self.prices.wear[a] == self.prices.wear[b]
                && self.model.strings()[a].parameters == self.model.strings()[b].parameters)
    }

    /// Groups of identical strings in service.
    pub(crate) fn kinds(&self) -> Vec<Vec<usize>> {
        kinds((0..self.n_strings()).filter(|&m| self.is_in_service(m)), |a, b| self.same_kind(a, b))
    }

    /// Initial temperatures of the strings and their ambient temperatures over the plan [degC].
    pub(crate) fn temperatures_c(&self, strings: impl IntoIterator<Item = usize>) -> Range {
        let ambient_c = self.intervals.iter().map(|interval| interval.ambient_c);
        ambient_c.chain(strings.into_iter().map(|m| self.start[m].temperature_c)).collect()
    }

    /// Temperature range of a grid [degC], from the coolest to at least `least_k` above the warmest temperature of idle strings. The grid
    /// ends at the temperature `stop_c` of full derating, if there is one.
    pub(crate) fn temperatures_to_c(&self, stop: Option<f64>, least_k: f64) -> Range {
        let Range { low, high } = self.temperatures_c(0..self.n_strings());
        Range { low, high: stop.unwrap_or(high + GRID_MARGIN_K).max(high + least_k) }
    }

    /// SOC change of a half-full string in a step at full power.
    pub(crate) fn soc_of_full_step(&self, m: usize) -> f64 {
        let string = &self.model.strings()[m];
        let p = &string.parameters;
        let middle = StringState { soc: 0.5 * (p.soc_min + p.soc_max), temperature_c: 25.0 };
        let volt = string.coefficients(Direction::Discharge, middle).voltage_v;
        string.nominal_w() / volt * self.dt_h() / p.capacity_ah
    }

    /// SOC that strings like `m` may reach, by full power in all steps and a margin for lower voltages.
    pub(crate) fn soc_range(&self, m: usize) -> Range {
        let p = &self.model.strings()[m].parameters;
        let full_step = 1.5 * self.soc_of_full_step(m);
        let steps = |direction: Direction| {
            let in_it = |t: &usize| self.intervals[*t].direction == direction && self.demand_w[*t] > 0.0;
            (0..self.n_steps()).filter(in_it).count() as f64
        };
        let starts: Range =
            (0..self.n_strings()).filter(|&k| self.same_kind(k, m)).map(|k| self.start[k].soc).collect();
        let low = (starts.low - steps(Direction::Discharge) * full_step).max(p.soc_min);
        let high = (starts.high + steps(Direction::Charge) * full_step).min(p.soc_max);
        Range { low, high: high.max(low + 1e-3) }
    }

    /// Whether two steps are equal for every string.
    pub(crate) fn same_step(&self, s: usize, t: usize) -> bool {
        self.curves.is_empty()
            && self.demand_w[s] == self.demand_w[t]
            && self.limits_w(s) == self.limits_w(t)
            && self.intervals[s] == self.intervals[t]
            && self.prices.losses[s] == self.prices.losses[t]
    }

    pub(crate) fn has_reactive(&self) -> bool {
        !self.curves.is_empty()
    }

    /// Loss of an inverter over its active power.
    #[inline]
    pub(crate) fn curve(&self, m: usize, t: usize) -> &LossCurve {
        if self.curves.is_empty() {
            return self.model.strings()[m].loss(self.intervals[t].direction);
        }
        &self.curves[self.inverters[m] * self.n_steps() + t]
    }

    #[inline]
    pub(crate) fn flow(&self, m: usize, t: usize, state: StringState, request_w: f64) -> Flow {
        self.flow_from(|| self.coefficients(m, t, state), (m, t), state, request_w)
    }

    /// Like [`Self::flow`], with known coefficients of the start.
    #[inline]
    fn flow_from(
        &self,
        at_start: impl FnOnce() -> Coefficients,
        (m, t): (usize, usize),
        state: StringState,
        request_w: f64,
    ) -> Flow {
        let (string, curve, interval) = (&self.model.strings()[m], self.curve(m, t), &self.intervals[t]);
        string.step_with(self.coefficients_from, curve, at_start, state, request_w, interval)
    }

    #[inline]
    pub(crate) fn coefficients(&self, m: usize, t: usize, state: StringState) -> Coefficients {
        self.model.strings()[m].coefficients(self.intervals[t].direction, state)
    }

    /// Maximum request of a string in a step [W].
    #[inline]
    pub(crate) fn limit_w(&self, m: usize, t: usize) -> f64 {
        self.limits_w(t)[m]
    }

    /// Maximum requests of a step `(M,)` [W].
    #[inline]
    pub(crate) fn limits_w(&self, t: usize) -> &[f64] {
        &self.limit_w[t * self.n_strings()..(t + 1) * self.n_strings()]
    }

    /// Maximum request of a string in a step, which is at most the demand [W].
    #[inline]
    pub(crate) fn cap_w(&self, m: usize, t: usize) -> f64 {
        self.demand_w[t].min(self.limit_w(m, t))
    }

    /// Whether a string is in service in any step.
    pub(crate) fn is_in_service(&self, m: usize) -> bool {
        (0..self.n_steps()).any(|t| self.limit_w(m, t) > 0.0)
    }

    /// The problem with a lower price of undelivered energy: no schedule costs more.
    pub(crate) fn relaxed(&self) -> Self {
        let mut relaxed = self.clone();
        for costs in &mut relaxed.prices.losses {
            let price = RELAXED_SHED_PRICE * costs.inverter.max(costs.battery);
            costs.availability = costs.availability.min(price);
            costs.derating = costs.derating.min(price);
        }
        relaxed
    }

    /// Price of undelivered energy [cost/Wh], an upper bound of the price of the demand.
    #[inline]
    pub(crate) fn shed_price(&self, t: usize) -> f64 {
        self.prices.losses[t].availability.max(self.prices.losses[t].derating)
    }

    /// Number of strings.
    pub fn n_strings(&self) -> usize {
        self.start.len()
    }

    /// Number of steps.
    pub fn n_steps(&self) -> usize {
        self.demand_w.len()
    }

    /// One step of a string from any point.
    #[inline]
    pub(crate) fn step(&self, m: usize, t: usize, from: &Point, request_w: f64) -> Point {
        self.step_from(|| self.coefficients(m, t, from.state), (m, t), from, request_w)
    }

    /// Like [`Self::step`], with known coefficients of the start.
    #[inline]
    pub(crate) fn step_from(
        &self,
        at_start: impl FnOnce() -> Coefficients,
        (m, t): (usize, usize),
        from: &Point,
        request_w: f64,
    ) -> Point {
        let flow = self.flow_from(at_start, (m, t), from.state, request_w);
        let (interval, p) = (&self.intervals[t], &self.prices);
        let mut rate = flow.losses().cost(&p.losses[t]) + p.wear[m] * flow.current_a.abs();
        if p.balance > 0.0 {
            let off = self.fill_of(m, flow.end) - self.fill[t];
            rate += self.imbalance[m * self.n_steps() + t] * off * off;
        }
        let running = flow.delivered_w > 0.0;
        let start = if running && !from.running { p.start } else { 0.0 };
        Point { state: flow.end, cost: from.cost + rate * interval.dt_h + start, running }
    }

    /// Cost of the final state of a string, relative to full or empty, so that it is never negative.
    #[inline]
    pub(crate) fn end_cost(&self, m: usize, state: StringState) -> f64 {
        let p = &self.model.strings()[m].parameters;
        let from = if self.prices.end_charge < 0.0 { p.soc_max } else { p.soc_min };
        self.prices.end_charge * self.capacity_ah(m) * (state.soc - from)
    }

    /// Fill of a string: share of its usable SOC window.
    #[inline]
    pub(crate) fn fill_of(&self, m: usize, state: StringState) -> f64 {
        let p = &self.model.strings()[m].parameters;
        (state.soc - p.soc_min) / (p.soc_max - p.soc_min)
    }

    #[inline]
    pub(crate) fn capacity_ah(&self, m: usize) -> f64 {
        self.model.strings()[m].parameters.capacity_ah
    }

    /// Capacity of a string, reduced while its inverter is limited, because unreachable charge does not help balancing.
    #[inline]
    pub(crate) fn usable_ah(&self, m: usize, t: usize) -> f64 {
        self.capacity_ah(m) * self.limit_w(m, t) / self.model.strings()[m].nominal_w()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::common;
    use bess_tables::Lut;

    #[test]
    fn a_coarse_problem_with_reactive_power_has_the_curve_of_each_inverter() {
        let mut system = common::reference(3);
        system.strings[2].inverter.loss_discharge = Lut::new("w", vec![0.0, 92e3], vec![5e3, 1e4]).unwrap();
        let model = ControlModel::new(&system);
        let interval = Interval { direction: Direction::Discharge, ambient_c: 25.0, dt_h: 0.25 };
        let losses = vec![Losses::default(); 4];
        let prices = Prices { losses, wear: vec![0.0; 3], start: 0.0, balance: 0.0, end_charge: 0.0 };
        let start = vec![StringState { soc: 0.5, temperature_c: 25.0 }; 3];
        let problem = PlanProblem::new(
            &model,
            start,
            vec![false; 3],
            &[150e3; 4],
            vec![interval; 4],
            &[92e3; 12],
            prices,
        )
        .and_then(|problem| problem.with_reactive(&[50e3; 4]))
        .unwrap();
        let coarse = problem.coarsened(2);
        for m in 0..3 {
            assert_eq!(problem.curve(m, 0).at(10e3), coarse.curve(m, 0).at(10e3), "string {m}");
        }
    }
}
