//! Marginal cost of charge and temperature of a string for the rest of the plan.

use crate::model::StringState;
use crate::plan::paths::{Paths, Point};

/// Steps of the difference quotients.
const SOC_SHIFT: f64 = 1e-3;
const TEMPERATURE_SHIFT_K: f64 = 0.1;

/// Co-states of one string: derivatives of the remaining cost at the start of each step `(T + 1,)`, from a backward
/// pass of difference quotients along its schedule.
#[derive(Debug, Clone)]
pub(crate) struct CoStates {
    pub soc: Vec<f64>,
    pub temperature: Vec<f64>,
}

impl CoStates {
    /// Co-states of a schedule are computed once, but count as work whenever they are asked for.
    pub fn along(paths: &mut Paths<'_>, m: usize) -> Self {
        let n_steps = paths.problem.n_steps();
        if let Some(known) = paths.co_states(m).clone() {
            paths.work += 2 * n_steps as u64;
            return known;
        }
        let mut slopes = Self { soc: vec![0.0; n_steps + 1], temperature: vec![0.0; n_steps + 1] };
        slopes.renew(paths, m, 0);
        *paths.co_states(m) = Some(slopes.clone());
        slopes
    }

    /// Co-states along the present path, from the start of step `from` on.
    pub fn renew(&mut self, paths: &mut Paths<'_>, m: usize, from: usize) {
        let problem = paths.problem;
        let n_steps = problem.n_steps();
        self.soc[n_steps] = problem.prices.end_charge * problem.capacity_ah(m);
        for t in (from..n_steps).rev() {
            let (here, next) = (*paths.at(m, t), *paths.at(m, t + 1));
            let request_w = paths.request(m, t);
            let change = |state: StringState| {
                let shifted = paths.next(m, t, &Point { state, ..here }, request_w);
                self.change(t + 1, &next, &shifted)
            };
            // Towards the inside of the window: states beyond a limit are invalid.
            let shift = if here.state.soc < 0.5 { SOC_SHIFT } else { -SOC_SHIFT };
            let by_soc = change(StringState { soc: here.state.soc + shift, ..here.state }) / shift;
            let warmer = here.state.temperature_c + TEMPERATURE_SHIFT_K;
            let by_temperature =
                change(StringState { temperature_c: warmer, ..here.state }) / TEMPERATURE_SHIFT_K;
            self.soc[t] = by_soc;
            self.temperature[t] = by_temperature;
        }
        paths.work += 2 * (n_steps - from) as u64;
    }

    /// First-order cost of the state `other` instead of `here` at the start of step `t`.
    #[inline]
    pub fn change(&self, t: usize, here: &Point, other: &Point) -> f64 {
        other.cost - here.cost
            + self.soc[t] * (other.state.soc - here.state.soc)
            + self.temperature[t] * (other.state.temperature_c - here.state.temperature_c)
    }
}
