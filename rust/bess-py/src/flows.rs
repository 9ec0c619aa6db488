//! Flows of schedules, as arrays.

use bess_control::Flow;
use bess_tables::units::W_PER_KW;
use bess_tables::Direction;
use pyo3::prelude::*;

use crate::arrays::{shaped, Numbers};

/// Flows of schedules, arrays `(M, T)` or, for a batch, `(B, M, T)`; positive = discharge, losses `>= 0`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct FlowArrays {
    delivered_kw: Numbers,
    availability_loss_kw: Numbers,
    derating_loss_kw: Numbers,
    inverter_loss_kw: Numbers,
    battery_loss_kw: Numbers,
    current_a: Numbers,
    /// At the end of the step, like the temperature.
    soc: Numbers,
    temperature_c: Numbers,
}

impl FlowArrays {
    /// From flows of a shape `(..., M, T)` and directions `(..., T)`.
    pub(crate) fn new(py: Python<'_>, shape: &[usize], flows: &[Flow], directions: &[Direction]) -> Self {
        let [.., n_strings, n_steps] = *shape else { unreachable!("strings and steps") };
        let sign = |i: usize| directions[i / (n_strings * n_steps) * n_steps + i % n_steps].sign();
        let pick = |of: &dyn Fn(usize, &Flow) -> f64| {
            shaped(py, shape, flows.iter().enumerate().map(|(i, flow)| of(i, flow)).collect())
        };
        Self {
            delivered_kw: pick(&|i, flow| sign(i) * flow.delivered_w / W_PER_KW),
            availability_loss_kw: pick(&|_, flow| flow.availability_w / W_PER_KW),
            derating_loss_kw: pick(&|_, flow| flow.derating_w / W_PER_KW),
            inverter_loss_kw: pick(&|_, flow| flow.inverter_w / W_PER_KW),
            battery_loss_kw: pick(&|_, flow| flow.battery_w / W_PER_KW),
            current_a: pick(&|i, flow| sign(i) * flow.current_a),
            soc: pick(&|_, flow| flow.end.soc),
            temperature_c: pick(&|_, flow| flow.end.temperature_c),
        }
    }
}
