//! Roll-outs of given schedules with everything that flows, for reports. The search uses objectives only.

use crate::model::{ControlModel, Interval, StringModel, StringState};
use crate::ControlError;

/// From which part of a step the coefficients of the control model are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CoefficientsFrom {
    /// Its start: the model of the certified split ([`StringModel::step`]).
    Start,
    /// Its middle: the model of plans ([`StringModel::step_midpoint`]).
    Middle,
}

/// Arrays of a batch of roll-outs, each `(B, M, T)`, positive = discharge, losses `>= 0`.
#[derive(Debug, Clone, Default)]
pub struct Rollouts {
    /// Delivered AC power [W].
    pub delivered_w: Vec<f64>,
    /// Availability loss [W].
    pub availability_w: Vec<f64>,
    /// Derating loss [W].
    pub derating_w: Vec<f64>,
    /// Inverter loss [W].
    pub inverter_w: Vec<f64>,
    /// Battery loss [W].
    pub battery_w: Vec<f64>,
    /// Current [A].
    pub current_a: Vec<f64>,
    /// SOC at the end of the step.
    pub soc: Vec<f64>,
    /// Mean temperature at the end of the step [degC].
    pub temperature_c: Vec<f64>,
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
    ) -> Result<Rollouts, ControlError> {
        let n_steps = ambient_c.len();
        let step = match coefficients {
            CoefficientsFrom::Start => StringModel::step,
            CoefficientsFrom::Middle => StringModel::step_midpoint,
        };
        let mut out = Rollouts::default();
        for request_w in requests_w.chunks_exact((start.len() * n_steps).max(1)) {
            let directions = self.directions(request_w, n_steps)?;
            for (m, string) in self.strings().iter().enumerate() {
                let mut state = start[m];
                for (t, (&direction, &ambient_c)) in directions.iter().zip(ambient_c).enumerate() {
                    let interval = Interval { direction, ambient_c, dt_h };
                    let request = request_w[m * n_steps + t].abs().min(string.nominal_w());
                    let flow = step(string, state, request, &interval);
                    let sign = direction.sign();
                    state = flow.end;
                    out.delivered_w.push(sign * flow.delivered_w);
                    out.availability_w.push(flow.availability_w);
                    out.derating_w.push(flow.derating_w);
                    out.inverter_w.push(flow.inverter_w);
                    out.battery_w.push(flow.battery_w);
                    out.current_a.push(sign * flow.current_a);
                    out.soc.push(state.soc);
                    out.temperature_c.push(state.temperature_c);
                }
            }
        }
        Ok(out)
    }
}
