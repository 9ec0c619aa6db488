//! The data of one split problem: strings, measured state, demand, limits, costs.

use std::sync::Arc;

use bess_tables::{Direction, System};

use crate::error::{check_length, check_range};
use crate::model::{Flow, Interval, Losses, StringModel, StringState};
use crate::ControlError;

/// Most groups of objectives.
pub const MAX_GROUPS: usize = 4;
/// Cost of each group.
pub type Costs = [f64; MAX_GROUPS];

const SOC_SLACK: f64 = 1e-9;
const POWER_SLACK: f64 = 1e-9;
/// A demand this close to the sum of the limits (relative) asks every string for its limit.
const FULL_POWER: f64 = 1e-12;
const TEMPERATURE_RANGE_C: (f64, f64) = (-100.0, 1000.0);

/// The control model of a plant, without a problem.
#[derive(Debug, Clone)]
pub struct ControlModel {
    /// Shared: a problem refers to the strings of its model and copies none of their tables.
    strings: Arc<[StringModel]>,
}

impl ControlModel {
    /// Prepares all strings.
    pub fn new(system: &System) -> Self {
        Self { strings: system.strings.iter().cloned().map(StringModel::new).collect() }
    }

    /// The strings.
    pub fn strings(&self) -> &[StringModel] {
        &self.strings
    }

    /// Checks measured states and pairs them up.
    ///
    /// # Errors
    ///
    /// Where the number of values is not that of the strings, an SOC is outside its string's window by more than rounding,
    /// or a temperature is not one of a battery [degC].
    pub fn states(&self, soc: &[f64], temperature_c: &[f64]) -> Result<Vec<StringState>, ControlError> {
        check_length("soc", soc, self.strings.len())?;
        check_length("temperature_c", temperature_c, self.strings.len())?;
        check_range("temperature_c", temperature_c, TEMPERATURE_RANGE_C, " degC")?;
        for (position, (string, &value)) in self.strings.iter().zip(soc).enumerate() {
            let (low, high) = (string.parameters.soc_min, string.parameters.soc_max);
            if !(low - SOC_SLACK..=high + SOC_SLACK).contains(&value) {
                return Err(ControlError::Range { name: "soc", position, value, low, high, unit: "" });
            }
        }
        let clamped = self
            .strings
            .iter()
            .zip(soc)
            .map(|(s, soc)| soc.clamp(s.parameters.soc_min, s.parameters.soc_max));
        Ok(clamped
            .zip(temperature_c)
            .map(|(soc, &temperature_c)| StringState { soc, temperature_c })
            .collect())
    }

    /// Directions of the steps of one schedule of signed requests `(M, T)` [W]; all strings of a step share it.
    ///
    /// # Errors
    ///
    /// [`ControlError::Range`] for a request above the nominal power of its string, [`ControlError::MixedSigns`] where the
    /// requests of a step have both signs.
    pub fn directions(&self, request_w: &[f64], n_steps: usize) -> Result<Vec<Direction>, ControlError> {
        let mut directions = vec![Direction::Discharge; n_steps];
        for (step, direction) in directions.iter_mut().enumerate() {
            let mut sign = 0.0;
            for (string, model) in self.strings.iter().enumerate() {
                let value = request_w[string * n_steps + step];
                let nominal = model.nominal_w();
                if value.is_nan() || value.abs() > nominal * (1.0 + POWER_SLACK) {
                    let position = string * n_steps + step;
                    let (low, high) = (-nominal, nominal);
                    return Err(ControlError::Range {
                        name: "request",
                        position,
                        value,
                        low,
                        high,
                        unit: " W",
                    });
                }
                if value * sign < 0.0 {
                    return Err(ControlError::MixedSigns { step, string, value_w: value });
                }
                if value != 0.0 {
                    sign = value;
                }
            }
            *direction = direction_of(sign);
        }
        Ok(directions)
    }

    /// Largest AC power that each string can deliver over the next interval, before derating [W].
    pub fn limits_w(&self, states: &[StringState], direction: Direction, dt_h: f64) -> Vec<f64> {
        let limit = |(string, state): (&StringModel, &StringState)| {
            string.limit_w(&string.coefficients(direction, *state), direction, state.soc, dt_h)
        };
        self.strings.iter().zip(states).map(limit).collect()
    }

    /// Constants that normalise the losses: inverter loss at `p_N` in charge, and
    /// `h_N = R(soc 0.5, 25 degC) (p_N / OCV_dch(0.5))^2`, for each string [W].
    pub fn nominal_losses_w(&self) -> (Vec<f64>, Vec<f64>) {
        let heat = |string: &StringModel| {
            let middle = StringState { soc: 0.5, temperature_c: 25.0 };
            let c = string.coefficients(Direction::Discharge, middle);
            c.resistance_ohm * (string.nominal_w() / c.voltage_v).powi(2)
        };
        let inverter = |string: &StringModel| string.loss(Direction::Charge).at(string.nominal_w()).0;
        (self.strings.iter().map(inverter).collect(), self.strings.iter().map(heat).collect())
    }
}

/// Direction of a signed power; zero counts as discharge, in which nothing flows.
pub fn direction_of(power: f64) -> Direction {
    if power < 0.0 {
        Direction::Charge
    } else {
        Direction::Discharge
    }
}

/// Everything about one split problem. Arrays over strings and steps are string-major, `(M, T)`.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// Measured SOC `(M,)`.
    pub soc: &'a [f64],
    /// Measured mean temperature `(M,)` [degC].
    pub temperature_c: &'a [f64],
    /// Demand, positive = discharge `(T,)` [W].
    pub demand_w: &'a [f64],
    /// Ambient temperature `(T,)` [degC].
    pub ambient_c: &'a [f64],
    /// Length of a step [h].
    pub dt_h: f64,
    /// Upper limits of the requests `(M, T)` [W].
    pub limit_w: &'a [f64],
    /// Costs of the losses `(G, M, 4)` [1/W], groups in order of priority.
    pub costs: &'a [f64],
    /// The same for the search, which gives a small weight to losses that cost nothing, so that ties have an answer.
    pub search_costs: &'a [f64],
    /// Absolute tolerance of each group.
    pub tolerance_abs: &'a [f64],
    /// Relative tolerance of each group.
    pub tolerance_rel: &'a [f64],
}

/// Which of the costs of a problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CostsOf {
    /// Of what is reported and bounded.
    Report,
    /// Of the search: losses that cost nothing have a small weight.
    Search,
}

/// A split problem, checked, as the search needs it. Requests are magnitudes from here on.
#[derive(Debug, Clone)]
pub struct ControlHorizon {
    pub(crate) model: ControlModel,
    pub(crate) start: Vec<StringState>,
    pub(crate) demand_w: Vec<f64>,
    pub(crate) intervals: Vec<Interval>,
    pub(crate) limit_w: Vec<f64>,
    /// Sum over the strings, `(T,)`.
    pub(crate) total_limit_w: Vec<f64>,
    /// Costs of the search `(M, G)`, so that those of one string lie together.
    pub(crate) search_costs: Vec<Losses>,
    /// Costs of what is reported and bounded, `(G, M)`.
    pub(crate) true_costs: Vec<Losses>,
    pub(crate) n_groups: usize,
    pub(crate) tolerance_abs: Vec<f64>,
    pub(crate) tolerance_rel: Vec<f64>,
}

impl ControlHorizon {
    /// Checks a problem.
    ///
    /// # Errors
    ///
    /// Where lengths do not agree, a number is outside what is allowed (the error says which, and the range), or the demand
    /// of a step is above the sum of its limits ([`ControlError::DemandAboveLimits`]).
    pub fn new(model: ControlModel, problem: &Problem<'_>) -> Result<Self, ControlError> {
        let (n_strings, n_steps) = (model.strings().len(), problem.demand_w.len());
        let n_groups = problem.tolerance_abs.len();
        let start = model.states(problem.soc, problem.temperature_c)?;
        check_length("ambient_c", problem.ambient_c, n_steps)?;
        check_length("limit", problem.limit_w, n_strings * n_steps)?;
        check_length("tol_rel", problem.tolerance_rel, n_groups)?;
        check_range("groups", &[n_groups as f64], (1.0, MAX_GROUPS as f64), "")?;
        check_range("dt_h", &[problem.dt_h], (f64::MIN_POSITIVE, f64::MAX), " h")?;
        check_range("ambient_c", problem.ambient_c, TEMPERATURE_RANGE_C, " degC")?;
        for costs in [problem.costs, problem.search_costs] {
            check_length("costs", costs, n_groups * n_strings * 4)?;
            check_range("costs", costs, (0.0, f64::MAX), " 1/W")?;
        }
        check_range("tol_abs", problem.tolerance_abs, (0.0, f64::MAX), "")?;
        check_range("tol_rel", problem.tolerance_rel, (0.0, f64::MAX), "")?;
        check_range("demand", problem.demand_w, (-f64::MAX, f64::MAX), " W")?;
        for (string, limits) in model.strings().iter().zip(problem.limit_w.chunks(n_steps.max(1))) {
            check_range("limit", limits, (0.0, string.nominal_w() * (1.0 + POWER_SLACK)), " W")?;
        }
        let total = |step: usize| (0..n_strings).map(|m| problem.limit_w[m * n_steps + step]).sum();
        let total_limit_w: Vec<f64> = (0..n_steps).map(total).collect();
        for (step, (demand, &limit_w)) in problem.demand_w.iter().zip(&total_limit_w).enumerate() {
            if demand.abs() > limit_w * (1.0 + POWER_SLACK) {
                return Err(ControlError::DemandAboveLimits { step, demand_w: *demand, limit_w });
            }
        }
        let intervals = problem.demand_w.iter().zip(problem.ambient_c).map(|(&demand, &ambient_c)| {
            Interval { direction: direction_of(demand), ambient_c, dt_h: problem.dt_h }
        });
        let losses = |costs: &[f64]| Losses::from_array([costs[0], costs[1], costs[2], costs[3]]);
        let of_string = |m: usize| (0..n_groups).map(move |g| (g * n_strings + m) * 4);
        let search_costs =
            (0..n_strings).flat_map(of_string).map(|first| losses(&problem.search_costs[first..first + 4]));
        Ok(Self {
            start,
            demand_w: problem.demand_w.iter().map(|d| d.abs()).collect(),
            intervals: intervals.collect(),
            limit_w: problem.limit_w.to_vec(),
            total_limit_w,
            search_costs: search_costs.collect(),
            true_costs: problem.costs.chunks_exact(4).map(losses).collect(),
            n_groups,
            tolerance_abs: problem.tolerance_abs.to_vec(),
            tolerance_rel: problem.tolerance_rel.to_vec(),
            model,
        })
    }

    /// Number of strings.
    pub fn n_strings(&self) -> usize {
        self.start.len()
    }

    /// Number of steps.
    pub fn n_steps(&self) -> usize {
        self.intervals.len()
    }

    /// Number of groups.
    pub fn n_groups(&self) -> usize {
        self.n_groups
    }

    /// Direction of each step.
    pub fn direction(&self, step: usize) -> Direction {
        self.intervals[step].direction
    }

    /// Strings of the plant.
    pub(crate) fn string(&self, m: usize) -> &StringModel {
        &self.model.strings()[m]
    }

    /// Costs of one string in the search, one entry for each group.
    #[inline]
    pub(crate) fn costs_of(&self, m: usize) -> &[Losses] {
        &self.search_costs[m * self.n_groups..(m + 1) * self.n_groups]
    }

    /// Costs of every string in one group: of what is reported and bounded, or of the search.
    pub(crate) fn group_costs(&self, group: usize, costs: CostsOf) -> Vec<Losses> {
        match costs {
            CostsOf::Report => {
                self.true_costs[group * self.n_strings()..(group + 1) * self.n_strings()].to_vec()
            }
            CostsOf::Search => (0..self.n_strings()).map(|m| self.costs_of(m)[group]).collect(),
        }
    }

    /// Limit of one request [W].
    #[inline]
    pub(crate) fn limit(&self, m: usize, t: usize) -> f64 {
        self.limit_w[m * self.n_steps() + t]
    }

    /// One step of one string; adds its costs.
    #[inline]
    pub(crate) fn advance(
        &self,
        m: usize,
        t: usize,
        state: StringState,
        request_w: f64,
        costs: &mut Costs,
    ) -> Flow {
        let flow = self.string(m).step(state, request_w, &self.intervals[t]);
        let losses = flow.losses();
        for (total, c) in costs.iter_mut().zip(self.costs_of(m)) {
            *total += losses.cost(c);
        }
        flow
    }

    /// Objectives of a schedule of requests `(M, T)` [W]: each string over time, then over the strings. Every
    /// other place that sums costs keeps this order, so that results agree to the last bit.
    pub fn objectives(&self, request_w: &[f64]) -> Costs {
        let n_steps = self.n_steps();
        let mut totals = [0.0; MAX_GROUPS];
        for (m, requests) in request_w.chunks_exact(n_steps).enumerate() {
            let mut costs = [0.0; MAX_GROUPS];
            let mut state = self.start[m];
            for (t, &request) in requests.iter().enumerate() {
                state = self.advance(m, t, state, request, &mut costs).end;
            }
            add(&mut totals, &costs);
        }
        totals
    }

    /// Objectives of what flows, `(M, T)`, in the costs of what is reported.
    pub fn true_objectives(&self, flows: &[Flow]) -> Costs {
        let mut totals = [0.0; MAX_GROUPS];
        for (m, row) in flows.chunks_exact(self.n_steps()).enumerate() {
            for flow in row {
                for (g, total) in totals[..self.n_groups].iter_mut().enumerate() {
                    *total += flow.losses().cost(&self.true_costs[g * self.n_strings() + m]);
                }
            }
        }
        totals
    }

    /// How far a group may rise above its best value while later groups are minimised,
    /// `F* + max(eps_abs, eps_rel |F*|)`.
    pub(crate) fn ceiling(&self, group: usize, best: f64) -> f64 {
        best + self.tolerance_abs[group].max(self.tolerance_rel[group] * best.abs())
    }

    /// What every string does in every step of a schedule, `(M, T)`.
    pub fn flows(&self, request_w: &[f64]) -> Vec<Flow> {
        let mut flows = Vec::with_capacity(request_w.len());
        for (m, requests) in request_w.chunks_exact(self.n_steps()).enumerate() {
            let mut state = self.start[m];
            for (&request_w, interval) in requests.iter().zip(&self.intervals) {
                let flow = self.string(m).step(state, request_w, interval);
                state = flow.end;
                flows.push(flow);
            }
        }
        flows
    }

    /// Steps in which there is something to decide: more than one string can run, and not all of them have to.
    pub fn n_free_steps(&self) -> usize {
        let several = |t: usize| (0..self.n_strings()).filter(|&m| self.limit(m, t) > 0.0).count() > 1;
        let free = |t: &usize| {
            several(*t)
                && self.demand_w[*t] > 0.0
                && self.demand_w[*t] < self.total_limit_w[*t] * (1.0 - FULL_POWER)
        };
        (0..self.n_steps()).filter(free).count()
    }

    /// Objectives of a batch of schedules `(B, M, T)` [W], `(B, G)`.
    pub fn evaluate(&self, requests_w: &[f64]) -> Vec<f64> {
        let size = self.n_strings() * self.n_steps();
        let groups = self.n_groups;
        requests_w
            .chunks_exact(size)
            .flat_map(|request| self.objectives(request).into_iter().take(groups))
            .collect()
    }

    /// Magnitudes of signed requests; an error where one points against the demand or is above its limit.
    ///
    /// # Errors
    ///
    /// [`ControlError::Range`] with the position of the request, beyond what the rounding of an optimiser explains.
    pub fn magnitudes(&self, requests_w: &[f64]) -> Result<Vec<f64>, ControlError> {
        let bounds: Vec<(f64, f64)> = (0..self.n_strings() * self.n_steps())
            .map(|i| {
                let t = i % self.n_steps();
                match self.direction(t) {
                    _ if self.demand_w[t] == 0.0 => (0.0, 0.0),
                    Direction::Charge => (-self.limit_w[i], 0.0),
                    Direction::Discharge => (0.0, self.limit_w[i]),
                }
            })
            .collect();
        // Rounding of an optimiser outside is let through, nothing more.
        let slack =
            1e-6 * (0..self.n_strings()).map(|m| self.string(m).nominal_w()).fold(f64::INFINITY, f64::min);
        let mut magnitudes = Vec::with_capacity(requests_w.len());
        for schedule in requests_w.chunks_exact(bounds.len().max(1)) {
            for (&value, &(low, high)) in schedule.iter().zip(&bounds) {
                if !(low - slack..=high + slack).contains(&value) {
                    let (name, position, unit) = ("request", magnitudes.len(), " W");
                    return Err(ControlError::Range { name, position, value, low, high, unit });
                }
                magnitudes.push(value.clamp(low, high).abs());
            }
        }
        Ok(magnitudes)
    }

    /// Signs of the demand on a schedule of magnitudes `(M, T)`.
    pub fn signed(&self, request_w: &[f64]) -> Vec<f64> {
        let sign = |t: usize| if self.direction(t) == Direction::Charge { -1.0 } else { 1.0 };
        request_w.iter().enumerate().map(|(i, u)| sign(i % self.n_steps()) * u).collect()
    }
}

/// Adds costs of all groups.
#[inline]
pub(crate) fn add(totals: &mut Costs, costs: &Costs) {
    for (total, cost) in totals.iter_mut().zip(costs) {
        *total += cost;
    }
}
