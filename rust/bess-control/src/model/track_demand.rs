//! Tracking of a demand on the whole plant: allocated at minimum loss; undeliverable power of full or empty strings is
//! reallocated to the others, and the remainder is unmet.

use bess_tables::{Direction, InputError};

use super::control_model::ControlModel;
use super::string::{Interval, StringState};
use crate::error::{check_length, check_range};

/// Maximum number of reallocations of undeliverable power in a step; each leaves a small remainder.
const ROUNDS: usize = 8;
/// Negligible power, as a share of the plant's power.
const NEGLIGIBLE_POWER: f64 = 1e-6;

/// Allocation of each power of the plant to the strings, in each direction.
#[derive(Debug, Clone)]
pub struct BestShares {
    charge_w: Vec<f64>,
    discharge_w: Vec<f64>,
    limit_w: Vec<f64>,
    total_w: f64,
}

/// Result of tracking; powers are means over the steps, positive = discharge.
#[derive(Debug, Clone, Default)]
pub struct TrackedDemand {
    /// Allocated demand: the demand without the undeliverable part `(T,)` [W].
    pub allocated_w: Vec<f64>,
    /// Delivered by all strings `(T,)` [W].
    pub delivered_w: Vec<f64>,
    /// Requests of the strings `(M, T)` [W].
    pub request_w: Vec<f64>,
    /// SOC at the start and at the end of each step `(M, T + 1)`.
    pub soc: Vec<f64>,
    /// Mean temperature at the same times [degC].
    pub temperature_c: Vec<f64>,
}

/// Flows of the strings in one step; powers are magnitudes.
#[derive(Debug, Clone)]
struct StepFlows {
    request_w: Vec<f64>,
    delivered_w: f64,
    /// Availability loss of each string.
    shed_w: Vec<f64>,
    end: Vec<StringState>,
}

impl BestShares {
    /// Powers of the strings `(P, M)` [W] in each direction, at `P` uniform powers of the plant from zero to
    /// the sum of the limits `(M,)`.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, there are fewer than two powers, or a number is not finite or negative.
    pub fn new(charge_w: Vec<f64>, discharge_w: Vec<f64>, limit_w: Vec<f64>) -> Result<Self, InputError> {
        let needed = (charge_w.len() / limit_w.len().max(1)).max(2) * limit_w.len();
        for (name, powers) in [("charge", &charge_w), ("discharge", &discharge_w), ("limit", &limit_w)] {
            check_range(name, powers, (0.0, f64::MAX), " W")?;
        }
        check_length("charge", &charge_w, needed)?;
        check_length("discharge", &discharge_w, needed)?;
        let total_w = limit_w.iter().sum();
        Ok(Self { charge_w, discharge_w, limit_w, total_w })
    }

    /// Powers of the strings for a power of the plant.
    fn of(&self, direction: Direction, power_w: f64) -> Vec<f64> {
        let n = self.limit_w.len();
        let table = direction.pick(&self.charge_w, &self.discharge_w);
        if power_w <= 0.0 {
            return vec![0.0; n];
        }
        let cells = table.len() / n - 1;
        let place = (power_w / self.total_w).min(1.0) * cells as f64;
        let cell = (place as usize).min(cells - 1);
        let (low, high) = (&table[cell * n..][..n], &table[(cell + 1) * n..][..n]);
        low.iter().zip(high).map(|(a, b)| a + (place - cell as f64) * (b - a)).collect()
    }

    /// Requests with the availability loss reallocated to strings without one, in proportion to their
    /// headroom; None if there is no loss or no headroom.
    fn reallocated(&self, done: &StepFlows) -> Option<Vec<f64>> {
        let min_w = NEGLIGIBLE_POWER * self.total_w;
        let undelivered: Vec<f64> = done.shed_w.iter().map(|&s| if s > min_w { s } else { 0.0 }).collect();
        let headroom = |((&undelivered, &limit), &request): ((&f64, &f64), &f64)| {
            if undelivered > 0.0 {
                0.0
            } else {
                (limit - request).max(0.0)
            }
        };
        let headroom: Vec<f64> =
            undelivered.iter().zip(&self.limit_w).zip(&done.request_w).map(headroom).collect();
        let (undelivered_w, headroom_w): (f64, f64) = (undelivered.iter().sum(), headroom.iter().sum());
        let amount = undelivered_w.min(headroom_w);
        if amount < min_w {
            return None;
        }
        let after = |m: usize| {
            let change = headroom[m] * (amount / headroom_w) - undelivered[m] * (amount / undelivered_w);
            (done.request_w[m] + change).clamp(0.0, self.limit_w[m])
        };
        Some((0..undelivered.len()).map(after).collect())
    }
}

impl ControlModel {
    /// Tracks a signed demand `(T,)` [W] from measured states, each step in `parts` of the midpoint rule.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, or a number is not finite.
    pub fn track_demand(
        &self,
        start: &[StringState],
        demand_w: &[f64],
        ambient_c: &[f64],
        dt_h: f64,
        parts: usize,
        shares: &BestShares,
    ) -> Result<TrackedDemand, InputError> {
        let (n_strings, n_steps) = (self.strings().len(), demand_w.len());
        check_length("shares", &shares.limit_w, n_strings)?;
        check_length("ambient_c", ambient_c, n_steps)?;
        check_range("parts", &[parts as f64], (1.0, f64::MAX), "")?;
        check_range("demand", demand_w, (-f64::MAX, f64::MAX), " W")?;
        let mut out = TrackedDemand {
            request_w: vec![0.0; n_strings * n_steps],
            soc: vec![0.0; n_strings * (n_steps + 1)],
            temperature_c: vec![0.0; n_strings * (n_steps + 1)],
            ..TrackedDemand::default()
        };
        let mut states = start.to_vec();
        for t in 0..=n_steps {
            for (m, state) in states.iter().enumerate() {
                out.soc[m * (n_steps + 1) + t] = state.soc;
                out.temperature_c[m * (n_steps + 1) + t] = state.temperature_c;
            }
            if t == n_steps {
                break;
            }
            let direction = Direction::of(demand_w[t]);
            let interval = Interval { direction, ambient_c: ambient_c[t], dt_h: dt_h / parts as f64 };
            let (allocated, done) = self.track_step(&states, demand_w[t].abs(), &interval, parts, shares);
            let sign = direction.sign();
            out.allocated_w.push(sign * allocated);
            out.delivered_w.push(sign * done.delivered_w);
            for (m, request) in done.request_w.iter().enumerate() {
                out.request_w[m * n_steps + t] = sign * request;
            }
            states = done.end;
        }
        Ok(out)
    }

    /// Requests of one step with negligible availability loss, and their flows.
    fn track_step(
        &self,
        states: &[StringState],
        mut allocated_w: f64,
        interval: &Interval,
        parts: usize,
        shares: &BestShares,
    ) -> (f64, StepFlows) {
        let mut rounds = ROUNDS;
        loop {
            let mut done = self.simulate(states, shares.of(interval.direction, allocated_w), interval, parts);
            for _ in 1..ROUNDS {
                let Some(request_w) = shares.reallocated(&done) else { break };
                done = self.simulate(states, request_w, interval, parts);
            }
            let shed_w: f64 = done.shed_w.iter().sum();
            if shed_w <= 0.0 || rounds == 0 {
                return (allocated_w, done);
            }
            rounds -= 1;
            allocated_w = (allocated_w - shed_w).max(0.0);
        }
    }

    fn simulate(
        &self,
        states: &[StringState],
        request_w: Vec<f64>,
        interval: &Interval,
        parts: usize,
    ) -> StepFlows {
        let (mut delivered_w, mut shed_w, mut end) = (0.0, vec![0.0; states.len()], states.to_vec());
        for (m, string) in self.strings().iter().enumerate() {
            for _ in 0..parts {
                let flow = string.step_midpoint(end[m], request_w[m], interval);
                delivered_w += flow.delivered_w / parts as f64;
                shed_w[m] += flow.availability_w / parts as f64;
                end[m] = flow.end;
            }
        }
        StepFlows { request_w, delivered_w, shed_w, end }
    }
}
