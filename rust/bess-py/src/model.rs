use bess_control::{CoefficientsFrom, Flow, Rollouts, StringState};
use bess_tables::units::W_PER_KW;
use bess_tables::Direction;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{check_shape, cube, flat, matrix, refused, vector, Cube, Matrix, Vector};
use crate::follow::{BestShares, FollowedArrays};
use crate::system::System;

/// What schedules do, each array `(B, M, T)`; positive = discharge, losses `>= 0`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct RolloutArrays {
    delivered_kw: Cube,
    availability_loss_kw: Cube,
    derating_loss_kw: Cube,
    inverter_loss_kw: Cube,
    battery_loss_kw: Cube,
    current_a: Cube,
    soc: Cube,
    temperature_c: Cube,
}

/// What one schedule does, each array `(M, T)`; positive = discharge, losses `>= 0`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct FlowArrays {
    delivered_kw: Matrix,
    availability_loss_kw: Matrix,
    derating_loss_kw: Matrix,
    inverter_loss_kw: Matrix,
    battery_loss_kw: Matrix,
    current_a: Matrix,
    soc: Matrix,
    temperature_c: Matrix,
}

impl FlowArrays {
    /// From flows `(M, T)` and the sign of each step.
    pub(crate) fn new(py: Python<'_>, flows: &[Flow], signs: &[f64]) -> Self {
        let n_steps = signs.len();
        let rows = flows.len() / n_steps.max(1);
        let pick = |of: &dyn Fn(usize, &Flow) -> f64| {
            matrix(py, rows, flows.iter().enumerate().map(|(i, flow)| of(i % n_steps, flow)).collect())
        };
        Self {
            delivered_kw: pick(&|t, flow| signs[t] * flow.delivered_w / W_PER_KW),
            availability_loss_kw: pick(&|_, flow| flow.availability_w / W_PER_KW),
            derating_loss_kw: pick(&|_, flow| flow.derating_w / W_PER_KW),
            inverter_loss_kw: pick(&|_, flow| flow.inverter_w / W_PER_KW),
            battery_loss_kw: pick(&|_, flow| flow.battery_w / W_PER_KW),
            current_a: pick(&|t, flow| signs[t] * flow.current_a),
            soc: pick(&|_, flow| flow.end.soc),
            temperature_c: pick(&|_, flow| flow.end.temperature_c),
        }
    }
}

/// Control model of a plant.
#[pyclass(frozen, module = "bess._core")]
pub struct ControlModel {
    pub(crate) inner: bess_control::ControlModel,
}

#[pymethods]
impl ControlModel {
    #[new]
    fn new(system: &System) -> Self {
        Self { inner: bess_control::ControlModel::new(&system.inner) }
    }

    /// Rolls out signed requests `(B, M, T)` [kW], with the coefficients of the start or the middle of each step.
    #[pyo3(signature = (soc0, temperature0_c, request_kw, ambient_c, dt_h, midpoint=false))]
    #[allow(clippy::too_many_arguments)]
    fn rollout(
        &self,
        py: Python<'_>,
        soc0: PyReadonlyArray1<'_, f64>,
        temperature0_c: PyReadonlyArray1<'_, f64>,
        request_kw: PyReadonlyArray3<'_, f64>,
        ambient_c: PyReadonlyArray1<'_, f64>,
        dt_h: f64,
        midpoint: bool,
    ) -> PyResult<RolloutArrays> {
        let coefficients = if midpoint { CoefficientsFrom::Middle } else { CoefficientsFrom::Start };
        let (soc, temperature_c) = (flat(soc0.as_array(), 1.0), flat(temperature0_c.as_array(), 1.0));
        let ambient_c = flat(ambient_c.as_array(), 1.0);
        let view = request_kw.as_array();
        let shape = view.dim();
        check_shape("request", &[shape.0, self.inner.strings().len(), ambient_c.len()], view.shape())?;
        let requests_w = flat(view, W_PER_KW);
        let out: Rollouts = py
            .detach(|| {
                let start = self.inner.states(&soc, &temperature_c)?;
                self.inner.rollout(&start, &requests_w, &ambient_c, dt_h, coefficients)
            })
            .map_err(refused)?;
        let scaled =
            |values: Vec<f64>, unit: f64| cube(py, shape, values.into_iter().map(|v| v / unit).collect());
        Ok(RolloutArrays {
            delivered_kw: scaled(out.delivered_w, W_PER_KW),
            availability_loss_kw: scaled(out.availability_w, W_PER_KW),
            derating_loss_kw: scaled(out.derating_w, W_PER_KW),
            inverter_loss_kw: scaled(out.inverter_w, W_PER_KW),
            battery_loss_kw: scaled(out.battery_w, W_PER_KW),
            current_a: scaled(out.current_a, 1.0),
            soc: scaled(out.soc, 1.0),
            temperature_c: scaled(out.temperature_c, 1.0),
        })
    }

    /// Follows a signed demand `(T,)` [kW], shared as loses least, each step in `parts` of the midpoint rule.
    #[allow(clippy::too_many_arguments)]
    fn follow(
        &self,
        py: Python<'_>,
        soc0: PyReadonlyArray1<'_, f64>,
        temperature0_c: PyReadonlyArray1<'_, f64>,
        demand_kw: PyReadonlyArray1<'_, f64>,
        ambient_c: PyReadonlyArray1<'_, f64>,
        dt_h: f64,
        parts: usize,
        shares: &BestShares,
    ) -> PyResult<FollowedArrays> {
        let (soc, temperature_c) = (flat(soc0.as_array(), 1.0), flat(temperature0_c.as_array(), 1.0));
        let (demand_w, ambient_c) = (flat(demand_kw.as_array(), W_PER_KW), flat(ambient_c.as_array(), 1.0));
        let followed = py
            .detach(|| {
                let start = self.inner.states(&soc, &temperature_c)?;
                self.inner.follow(&start, &demand_w, &ambient_c, dt_h, parts, &shares.inner)
            })
            .map_err(refused)?;
        Ok(FollowedArrays::new(py, self.inner.strings().len(), followed))
    }

    /// Open-circuit voltage [V] and resistance [Ohm] of every string at states `(M, N)` in one direction.
    fn coefficients(
        &self,
        py: Python<'_>,
        soc: PyReadonlyArray2<'_, f64>,
        temperature_c: PyReadonlyArray2<'_, f64>,
        discharge: bool,
    ) -> PyResult<(Matrix, Matrix)> {
        let (n_strings, shape) = (self.inner.strings().len(), soc.shape());
        check_shape("soc", &[n_strings, shape[1]], shape)?;
        check_shape("temperature_c", shape, temperature_c.shape())?;
        let direction = if discharge { Direction::Discharge } else { Direction::Charge };
        let (soc, temperature_c) = (soc.as_array(), temperature_c.as_array());
        let at = |(((m, _), &soc), &temperature_c): (((usize, usize), &f64), &f64)| {
            let state = StringState { soc, temperature_c };
            let c = self.inner.strings()[m].coefficients(direction, state);
            (c.voltage_v, c.resistance_ohm)
        };
        let (voltage_v, resistance_ohm) = soc.indexed_iter().zip(&temperature_c).map(at).unzip();
        Ok((matrix(py, n_strings, voltage_v), matrix(py, n_strings, resistance_ohm)))
    }

    /// Largest AC power of each string over the next interval, before derating `(M,)` [kW].
    fn max_power_kw(
        &self,
        py: Python<'_>,
        soc0: PyReadonlyArray1<'_, f64>,
        temperature0_c: PyReadonlyArray1<'_, f64>,
        discharge: bool,
        dt_h: f64,
    ) -> PyResult<Vector> {
        let (soc, temperature_c) = (flat(soc0.as_array(), 1.0), flat(temperature0_c.as_array(), 1.0));
        let states = self.inner.states(&soc, &temperature_c).map_err(refused)?;
        let direction = if discharge { Direction::Discharge } else { Direction::Charge };
        let limits = self.inner.limits_w(&states, direction, dt_h);
        Ok(vector(py, limits.into_iter().map(|p| p / W_PER_KW).collect()))
    }

    /// Reactive power of each string `(M,)` [kvar] of a total, signed alike, that loses least beside signed requests `(M,)`
    /// [kW] within `limit_kva` `(M,)`; starting a string is worth `start_kw` `(M,)`.
    fn share_reactive(
        &self,
        py: Python<'_>,
        request_kw: PyReadonlyArray1<'_, f64>,
        total_kvar: f64,
        limit_kva: PyReadonlyArray1<'_, f64>,
        start_kw: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Vector> {
        let watts = |values: PyReadonlyArray1<'_, f64>| flat(values.as_array(), W_PER_KW);
        let (request_w, limit_va, start_w) = (watts(request_kw), watts(limit_kva), watts(start_kw));
        let total_var = total_kvar.abs() * W_PER_KW;
        let shares = py
            .detach(|| self.inner.share_reactive(&request_w, total_var, &limit_va, &start_w))
            .map_err(refused)?;
        let unit = if total_kvar < 0.0 { -W_PER_KW } else { W_PER_KW };
        Ok(vector(py, shares.into_iter().map(|q| q / unit).collect()))
    }

    /// Constants of normalisation of each string [kW]: inverter loss at `p_N` in charge, and `h_N`.
    fn nominal_loss_kw(&self, py: Python<'_>) -> (Vector, Vector) {
        let (inverter, battery) = self.inner.nominal_losses_w();
        let kw = |values: Vec<f64>| vector(py, values.into_iter().map(|p| p / W_PER_KW).collect());
        (kw(inverter), kw(battery))
    }
}
