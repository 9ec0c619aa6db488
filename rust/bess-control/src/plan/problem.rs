//! What a plan is made for: strings, measured state, demand, limits, surroundings, prices.

use std::ops::Range;

use bess_tables::Direction;

use crate::error::{check_length, check_range};
use crate::model::{ControlModel, Flow, Interval, LossCurve, Losses, StringState, TEMPERATURE_RANGE_C};
use crate::plan::paths::Paths;
use crate::reactive::curve_at_power_factor;
use crate::ControlError;

/// What counts in a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Prices {
    /// A watt-hour lost, for each step `(T,)` [cost/Wh]. The unit of cost is that of the objective: kWh, or EUR.
    pub losses: Vec<Losses>,
    /// Wear by the charge that a string moves, in either direction `(M,)` [cost/Ah].
    pub wear: Vec<f64>,
    /// A start of an inverter [cost].
    pub start: f64,
    /// Imbalance: squared distance of a string's fill from that of the plant [cost per Ah of capacity and hour].
    pub balance: f64,
    /// Charge left at the end [cost/Ah]; negative, because it is worth having.
    pub end_charge: f64,
}

/// One plan's data. Arrays over strings and steps are string-major, `(M, T)`; requests are magnitudes in the direction of
/// their step.
#[derive(Debug, Clone)]
pub struct PlanProblem<'a> {
    pub(crate) model: &'a ControlModel,
    /// Measured states `(M,)`.
    pub(crate) start: Vec<StringState>,
    /// Whether each inverter runs before the first step `(M,)`.
    pub(crate) running: Vec<bool>,
    /// Magnitudes `(T,)` [W], at most the sum of the limits.
    pub(crate) demand_w: Vec<f64>,
    /// Direction, surroundings and length of each step `(T,)`.
    pub(crate) intervals: Vec<Interval>,
    /// Largest requests of all steps `(M,)` [W].
    pub(crate) limit_w: Vec<f64>,
    pub(crate) prices: Prices,
    /// Share of its usable charge that the plant holds at the end of each step `(T,)`: imbalance is measured from there.
    pub(crate) fill: Vec<f64>,
    /// What imbalance counts in each step `(T,)`: 1 where the plant will still come near empty or full, little where not.
    pub(crate) tightness: Vec<f64>,
    /// Losses of the inverters with the reactive power of each step `(M, T)`; empty where there is none.
    curves: Vec<LossCurve>,
}

impl<'a> PlanProblem<'a> {
    /// Checks a problem.
    ///
    /// `start` and `running` `(M,)`: measured state, and whether each inverter runs. `demand_w` `(T,)` has no sign, that is
    /// in `intervals`; what is above the sum of the limits `limit_w` `(M,)`, which hold for all steps, is left out.
    ///
    /// # Errors
    ///
    /// Where lengths do not agree, or a number is not finite or negative.
    pub fn new(
        model: &'a ControlModel,
        start: Vec<StringState>,
        running: Vec<bool>,
        demand_w: &[f64],
        intervals: Vec<Interval>,
        limit_w: Vec<f64>,
        prices: Prices,
    ) -> Result<Self, ControlError> {
        let (n_strings, n_steps) = (model.strings().len(), demand_w.len());
        check_length("start", &start, n_strings)?;
        check_length("running", &running, n_strings)?;
        check_length("limit", &limit_w, n_strings)?;
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
        for (string, &limit) in model.strings().iter().zip(&limit_w) {
            check_range("limit", &[limit], (0.0, string.nominal_w() * (1.0 + 1e-9)), " W")?;
        }
        let total: f64 = limit_w.iter().sum();
        let demand_w = demand_w.iter().map(|d| d.min(total)).collect();
        let (fill, tightness) = (vec![0.0; n_steps], vec![0.0; n_steps]);
        Ok(Self {
            model,
            start,
            running,
            demand_w,
            intervals,
            limit_w,
            prices,
            fill,
            tightness,
            curves: vec![],
        })
    }

    /// The same with a demand of reactive power, magnitudes `(T,)` [var]; what the inverters cannot carry beside the active
    /// power is left out.
    ///
    /// In a plan every string carries reactive power in proportion to its active power, and what would overload it runs
    /// another inverter like it: losses are those of the plant's power factor. Sharing by [`ControlModel::share_reactive`]
    /// what the plan asks of a step loses no more than that, but where there is no such other inverter.
    ///
    /// # Errors
    ///
    /// Where the length is not that of the demand, or a number is not finite or negative.
    pub fn with_reactive(mut self, reactive_var: &[f64]) -> Result<Self, ControlError> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        check_length("reactive power", reactive_var, n_steps)?;
        check_range("reactive power", reactive_var, (0.0, f64::MAX), " var")?;
        let total: f64 = self.limit_w.iter().sum();
        let factors: Vec<f64> = self
            .demand_w
            .iter()
            .zip(reactive_var)
            .map(|(&p, q)| if p > 0.0 { p.hypot(*q).min(total).max(p) / p } else { 1.0 })
            .collect();
        for m in 0..n_strings {
            for (t, &factor) in factors.iter().enumerate() {
                let curve = self.model.strings()[m].loss(self.intervals[t].direction);
                let nominal_w = self.model.strings()[m].nominal_w();
                self.curves.push(curve_at_power_factor(curve, nominal_w, factor, self.demand_w[t]));
            }
        }
        Ok(self)
    }

    /// The problem in steps `per` times as long: mean demand, ambient temperature and prices of each `per` steps.
    pub(crate) fn coarsened(&self, per: usize) -> Self {
        let n_steps = self.n_steps();
        let blocks: Vec<_> = (0..n_steps).step_by(per).map(|from| from..(from + per).min(n_steps)).collect();
        let mean = |block: &Range<usize>, of: &dyn Fn(usize) -> f64| {
            block.clone().map(of).sum::<f64>() / block.len() as f64
        };
        let signed_w = |t: usize| self.intervals[t].direction.sign() * self.demand_w[t];
        let mut coarse = self.clone();
        coarse.demand_w = blocks.iter().map(|b| mean(b, &signed_w).abs()).collect();
        coarse.intervals = blocks
            .iter()
            .map(|b| Interval {
                direction: Direction::of(mean(b, &signed_w)),
                ambient_c: mean(b, &|t| self.intervals[t].ambient_c),
                dt_h: self.intervals[b.start].dt_h * per as f64,
            })
            .collect();
        let price = |b: &Range<usize>, kind: usize| mean(b, &|t| self.prices.losses[t].to_array()[kind]);
        coarse.prices.losses =
            blocks.iter().map(|b| Losses::from_array([0, 1, 2, 3].map(|kind| price(b, kind)))).collect();
        coarse.prices.balance = 0.0;
        if !self.curves.is_empty() {
            let curve = |m: usize, b: &Range<usize>| self.curve(m, b.start).clone();
            coarse.curves =
                (0..self.n_strings()).flat_map(|m| blocks.iter().map(move |b| curve(m, b))).collect();
        }
        coarse
    }

    /// Steps that make up a time of about `hours`, at least one.
    pub(crate) fn steps_of(&self, hours: f64) -> usize {
        self.intervals.first().map_or(1, |i| ((hours / i.dt_h).round() as usize).max(1))
    }

    /// Whether two strings are the same but for their states.
    pub(crate) fn alike(&self, a: usize, b: usize) -> bool {
        a == b
            || (self.limit_w[a] == self.limit_w[b]
                && self.prices.wear[a] == self.prices.wear[b]
                && self.model.strings()[a].parameters == self.model.strings()[b].parameters)
    }

    /// Whether two steps are the same for every string.
    pub(crate) fn same_step(&self, s: usize, t: usize) -> bool {
        self.curves.is_empty()
            && self.demand_w[s] == self.demand_w[t]
            && self.intervals[s] == self.intervals[t]
            && self.prices.losses[s] == self.prices.losses[t]
    }

    /// Whether inverters carry reactive power.
    pub(crate) fn has_reactive(&self) -> bool {
        !self.curves.is_empty()
    }

    /// Cost of a schedule `(M, T)` [W].
    pub(crate) fn cost(&self, request_w: &[f64]) -> f64 {
        Paths::new(self, request_w.to_vec()).cost()
    }

    /// Loss of an inverter over its active power.
    #[inline]
    pub(crate) fn curve(&self, m: usize, t: usize) -> &LossCurve {
        if self.curves.is_empty() {
            return self.model.strings()[m].loss(self.intervals[t].direction);
        }
        &self.curves[m * self.n_steps() + t]
    }

    /// What one string does in one step.
    #[inline]
    pub(crate) fn flow(&self, m: usize, t: usize, state: StringState, request_w: f64) -> Flow {
        let string = &self.model.strings()[m];
        string.step_midpoint_with(self.curve(m, t), state, request_w, &self.intervals[t])
    }

    /// Number of strings.
    pub fn n_strings(&self) -> usize {
        self.limit_w.len()
    }

    /// Number of steps.
    pub fn n_steps(&self) -> usize {
        self.demand_w.len()
    }

    /// One step of one string: its cost and where it ends.
    #[inline]
    pub(crate) fn step(
        &self,
        m: usize,
        t: usize,
        state: StringState,
        request_w: f64,
        running: bool,
    ) -> (f64, StringState) {
        let interval = &self.intervals[t];
        let flow = self.flow(m, t, state, request_w);
        let p = &self.prices;
        let mut rate = flow.losses().cost(&p.losses[t]) + p.wear[m] * flow.current_a.abs();
        if p.balance > 0.0 {
            let off = self.fill_of(m, flow.end) - self.fill[t];
            rate += p.balance * self.tightness[t] * self.usable_ah(m) * off * off;
        }
        let start = if running || request_w <= 0.0 { 0.0 } else { p.start };
        (rate * interval.dt_h + start, flow.end)
    }

    /// Cost of the state in which the plan leaves a string. Measured from full or empty, so that it is never negative.
    #[inline]
    pub(crate) fn end_cost(&self, m: usize, state: StringState) -> f64 {
        let p = &self.model.strings()[m].parameters;
        let from = if self.prices.end_charge < 0.0 { p.soc_max } else { p.soc_min };
        self.prices.end_charge * self.capacity_ah(m) * (state.soc - from)
    }

    /// Share of its usable SOC window that a string holds.
    #[inline]
    pub(crate) fn fill_of(&self, m: usize, state: StringState) -> f64 {
        let p = &self.model.strings()[m].parameters;
        (state.soc - p.soc_min) / (p.soc_max - p.soc_min)
    }

    #[inline]
    pub(crate) fn capacity_ah(&self, m: usize) -> f64 {
        self.model.strings()[m].parameters.capacity_ah
    }

    /// Capacity of a string, less where its inverter is limited: charge that cannot be reached balances nothing.
    #[inline]
    pub(crate) fn usable_ah(&self, m: usize) -> f64 {
        self.capacity_ah(m) * self.limit_w[m] / self.model.strings()[m].nominal_w()
    }
}
