//! The data of one split problem: strings, measured state, demand, limits, costs; and the sign of its requests.

use bess_tables::{Direction, InputError};

use super::control_model::{ControlModel, POWER_SLACK, TEMPERATURE_RANGE_C};
use crate::cores;
use crate::error::{check_length, check_range, out_of_range};
use crate::model::{Interval, Losses, StringModel, StringState};

/// Maximum number of groups of objectives.
pub const MAX_GROUPS: usize = 4;
/// Relative distance of the demand from the sum of the limits within which every string gets its limit.
const FULL_POWER: f64 = 1e-12;
/// Minimum number of string-steps for work on several cores.
const MIN_PARALLEL_STRING_STEPS: usize = 64;

/// Data of one split problem. Arrays over strings and steps are string-major, `(M, T)`.
#[derive(Debug, Clone, Copy)]
pub struct SplitProblem<'a> {
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
    /// Costs of the search, with a small weight for losses of zero cost, to break ties.
    pub search_costs: &'a [f64],
    /// Absolute tolerance of each group.
    pub tolerance_abs: &'a [f64],
    /// Relative tolerance of each group.
    pub tolerance_rel: &'a [f64],
}

/// A checked split problem, prepared for the search. Requests are magnitudes from here on.
#[derive(Debug, Clone)]
pub struct ControlHorizon {
    pub(crate) model: ControlModel,
    /// Measured states `(M,)`.
    pub(crate) start: Vec<StringState>,
    /// Magnitudes `(T,)` [W].
    pub(crate) demand_w: Vec<f64>,
    /// Direction, ambient temperature and length of each step `(T,)`.
    pub(crate) intervals: Vec<Interval>,
    /// Maximum requests `(M, T)` [W].
    pub(crate) limit_w: Vec<f64>,
    /// Sum of these limits over the strings, `(T,)` [W].
    pub(crate) total_limit_w: Vec<f64>,
    /// Costs of the search `(M, G)`, contiguous for each string.
    pub(crate) search_costs: Vec<Losses>,
    /// Costs of reported objectives and bounds, `(G, M)`.
    pub(crate) report_costs: Vec<Losses>,
    pub(crate) n_groups: usize,
    /// Tolerance of each group above its best value while later groups are minimised `(G,)`.
    pub(crate) tolerance_abs: Vec<f64>,
    pub(crate) tolerance_rel: Vec<f64>,
}

impl ControlHorizon {
    /// Checks a problem.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, a number is outside its range (both are in the message), or the demand
    /// of a step exceeds the sum of its limits.
    pub fn new(model: ControlModel, problem: &SplitProblem<'_>) -> Result<Self, InputError> {
        let (n_strings, n_steps) = (model.strings().len(), problem.demand_w.len());
        let n_groups = problem.tolerance_abs.len();
        let start = model.states(problem.soc, problem.temperature_c)?;
        check_length("demand", problem.demand_w, n_steps.max(1))?;
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
        for (string, limits) in model.strings().iter().zip(problem.limit_w.chunks(n_steps)) {
            check_range("limit", limits, (0.0, string.nominal_w() * (1.0 + POWER_SLACK)), " W")?;
        }
        let total = |step: usize| (0..n_strings).map(|m| problem.limit_w[m * n_steps + step]).sum();
        let total_limit_w: Vec<f64> = (0..n_steps).map(total).collect();
        for (step, (demand, &limit_w)) in problem.demand_w.iter().zip(&total_limit_w).enumerate() {
            if demand.abs() > limit_w * (1.0 + POWER_SLACK) {
                return Err(InputError(format!(
                    "step {step}: demand of {demand} W is above the sum of the limits, {limit_w} W"
                )));
            }
        }
        let intervals = problem.demand_w.iter().zip(problem.ambient_c).map(|(&demand, &ambient_c)| {
            Interval { direction: Direction::of(demand), ambient_c, dt_h: problem.dt_h }
        });
        let by_group = Losses::rows(problem.search_costs);
        let of_string = |m: usize| (0..n_groups).map(move |g| g * n_strings + m);
        let search_costs = (0..n_strings).flat_map(of_string).map(|place| by_group[place]);
        Ok(Self {
            start,
            demand_w: problem.demand_w.iter().map(|d| d.abs()).collect(),
            intervals: intervals.collect(),
            limit_w: problem.limit_w.to_vec(),
            total_limit_w,
            search_costs: search_costs.collect(),
            report_costs: Losses::rows(problem.costs),
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

    /// String-steps in one roll-out of all strings.
    pub(crate) fn size(&self) -> usize {
        self.n_strings() * self.n_steps()
    }

    /// Results of `of` for every item, on all cores if the problem is large; threads do not pay off for small problems.
    pub(crate) fn map<I: Send, T: Send>(&self, items: Vec<I>, of: impl Fn(I) -> T + Sync) -> Vec<T> {
        if self.size() < MIN_PARALLEL_STRING_STEPS {
            return items.into_iter().map(of).collect();
        }
        cores::map(items, of)
    }

    /// Number of groups.
    pub fn n_groups(&self) -> usize {
        self.n_groups
    }

    /// Direction of each step.
    pub fn direction(&self, step: usize) -> Direction {
        self.intervals[step].direction
    }

    pub(crate) fn string(&self, m: usize) -> &StringModel {
        &self.model.strings()[m]
    }

    #[inline]
    pub(crate) fn limit(&self, m: usize, t: usize) -> f64 {
        self.limit_w[m * self.n_steps() + t]
    }

    /// Limits of all requests of a step, `(M,)` [W].
    pub(crate) fn limits(&self, t: usize) -> Vec<f64> {
        (0..self.n_strings()).map(|m| self.limit(m, t)).collect()
    }

    /// Steps with a decision: more than one string can be on, and not all of them must be.
    pub fn n_free_steps(&self) -> usize {
        let several = |t: usize| (0..self.n_strings()).filter(|&m| self.limit(m, t) > 0.0).count() > 1;
        let free = |t: &usize| {
            several(*t)
                && self.demand_w[*t] > 0.0
                && self.demand_w[*t] < self.total_limit_w[*t] * (1.0 - FULL_POWER)
        };
        (0..self.n_steps()).filter(free).count()
    }

    /// Magnitudes of signed requests; an error if one is opposite to the demand or above its limit.
    ///
    /// # Errors
    ///
    /// A request, with its position, that is outside its range beyond the rounding error of an optimiser.
    pub fn magnitudes(&self, requests_w: &[f64]) -> Result<Vec<f64>, InputError> {
        let bounds: Vec<(f64, f64)> = (0..self.n_strings() * self.n_steps())
            .map(|i| {
                let t = i % self.n_steps();
                let max_w = if self.demand_w[t] == 0.0 { 0.0 } else { self.limit_w[i] };
                self.direction(t).pick((-max_w, 0.0), (0.0, max_w))
            })
            .collect();
        // Only rounding errors of an external optimiser are accepted.
        let slack =
            1e-6 * (0..self.n_strings()).map(|m| self.string(m).nominal_w()).fold(f64::INFINITY, f64::min);
        let mut magnitudes = Vec::with_capacity(requests_w.len());
        for schedule in requests_w.chunks_exact(bounds.len().max(1)) {
            for (&value, &(low, high)) in schedule.iter().zip(&bounds) {
                if !(low - slack..=high + slack).contains(&value) {
                    return Err(out_of_range("request", magnitudes.len(), value, (low, high), " W"));
                }
                magnitudes.push(value.clamp(low, high).abs());
            }
        }
        Ok(magnitudes)
    }

    /// Signs of the demand on a schedule of magnitudes `(M, T)`.
    pub fn signed(&self, request_w: &[f64]) -> Vec<f64> {
        let sign = |i: usize| self.direction(i % self.n_steps()).sign();
        request_w.iter().enumerate().map(|(i, u)| sign(i) * u).collect()
    }
}
