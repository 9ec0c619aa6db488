//! Roll-outs of given schedules on the strings of a plant.

use bess_tables::{Direction, InputError};

use crate::model::{CoefficientsFrom, ControlModel, Flow, Interval, StringState};

/// Flows of a batch of schedules.
#[derive(Debug, Clone, Default)]
pub struct Rollout {
    /// Flows `(B, M, T)`.
    pub flows: Vec<Flow>,
    /// Directions `(B, T)`.
    pub directions: Vec<Direction>,
}

impl ControlModel {
    /// Rolls out a batch of signed requests `(B, M, T)` [W] from one state.
    ///
    /// # Errors
    ///
    /// As [`Self::directions`]: a request above the nominal power, or requests of both signs in one step.
    pub fn rollout(
        &self,
        start: &[StringState],
        requests_w: &[f64],
        ambient_c: &[f64],
        dt_h: f64,
        coefficients: CoefficientsFrom,
    ) -> Result<Rollout, InputError> {
        let n_steps = ambient_c.len();
        let mut out = Rollout::default();
        for request_w in requests_w.chunks_exact((start.len() * n_steps).max(1)) {
            let directions = self.directions(request_w, n_steps)?;
            for (m, string) in self.strings().iter().enumerate() {
                let mut state = start[m];
                for (t, (&direction, &ambient_c)) in directions.iter().zip(ambient_c).enumerate() {
                    let interval = Interval { direction, ambient_c, dt_h };
                    let request_w = request_w[m * n_steps + t].abs().min(string.nominal_w());
                    let flow = string.step_from(coefficients, state, request_w, &interval);
                    state = flow.end;
                    out.flows.push(flow);
                }
            }
            out.directions.extend(directions);
        }
        Ok(out)
    }
}
