//! The tables of a plant, and its control model: roll-outs, tracking of a demand, limits, reactive power.

use std::sync::Arc;

use bess_control::{CoefficientsFrom, Flow, StringState};
use bess_tables::units::W_PER_KW;
use bess_tables::Direction;
use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;

use crate::arrays::{
    check_shape, kilowatts, matrix, numbers, shaped, value_error, vector, watts, CubeIn, Matrix, MatrixIn,
    Numbers, Vector, VectorIn,
};

/// Tables of a plant, shared by every object built from it.
#[pyclass(frozen, module = "bess._core")]
pub struct System {
    pub(crate) inner: Arc<bess_tables::System>,
}

#[pymethods]
impl System {
    /// Creates the tables from the resolved description, JSON of `{"strings": [...]}`.
    #[new]
    fn new(document: &str) -> PyResult<Self> {
        let inner = bess_tables::System::from_json(document).map_err(value_error)?;
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Returns a copy with the capacity and resistance of each string scaled by these factors.
    fn aged(&self, soh_capacity: VectorIn<'_>, soh_resistance: VectorIn<'_>) -> PyResult<Self> {
        let inner =
            self.inner.aged(&numbers(&soh_capacity), &numbers(&soh_resistance)).map_err(value_error)?;
        Ok(Self { inner: Arc::new(inner) })
    }
}

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

/// Control model of a plant.
#[pyclass(frozen, module = "bess._core")]
pub struct ControlModel {
    pub(crate) inner: bess_control::ControlModel,
}

impl ControlModel {
    /// Measured states of all strings.
    pub(crate) fn states(
        &self,
        soc: &VectorIn<'_>,
        temperature_c: &VectorIn<'_>,
    ) -> PyResult<Vec<StringState>> {
        self.inner.states(&numbers(soc), &numbers(temperature_c)).map_err(value_error)
    }
}

fn direction(discharge: bool) -> Direction {
    if discharge {
        Direction::Discharge
    } else {
        Direction::Charge
    }
}

#[pymethods]
impl ControlModel {
    #[new]
    fn new(system: &System) -> Self {
        Self { inner: bess_control::ControlModel::new(&system.inner) }
    }

    /// Rolls out signed requests `(B, M, T)` [kW], with the coefficients at the start or the middle of each step.
    #[pyo3(signature = (soc, temperature_c, request_kw, ambient_c, dt_h, midpoint=false))]
    fn rollout(
        &self,
        py: Python<'_>,
        soc: VectorIn<'_>,
        temperature_c: VectorIn<'_>,
        request_kw: CubeIn<'_>,
        ambient_c: VectorIn<'_>,
        dt_h: f64,
        midpoint: bool,
    ) -> PyResult<FlowArrays> {
        let coefficients = if midpoint { CoefficientsFrom::Middle } else { CoefficientsFrom::Start };
        let shape = [request_kw.shape()[0], self.inner.strings().len(), ambient_c.len()];
        check_shape("request", &shape, request_kw.shape())?;
        let start = self.states(&soc, &temperature_c)?;
        let (requests_w, ambient_c) = (watts(&request_kw), numbers(&ambient_c));
        let out = py
            .detach(|| self.inner.rollout(&start, &requests_w, &ambient_c, dt_h, coefficients))
            .map_err(value_error)?;
        Ok(FlowArrays::new(py, &shape, &out.flows, &out.directions))
    }

    /// Tracks a signed demand `(T,)` [kW], allocated at minimum loss, each step in `parts` of the midpoint rule.
    fn track_demand(
        &self,
        py: Python<'_>,
        soc: VectorIn<'_>,
        temperature_c: VectorIn<'_>,
        demand_kw: VectorIn<'_>,
        ambient_c: VectorIn<'_>,
        dt_h: f64,
        parts: usize,
        shares: &BestShares,
    ) -> PyResult<TrackedArrays> {
        let start = self.states(&soc, &temperature_c)?;
        let (demand_w, ambient_c) = (watts(&demand_kw), numbers(&ambient_c));
        let tracked = py
            .detach(|| self.inner.track_demand(&start, &demand_w, &ambient_c, dt_h, parts, &shares.inner))
            .map_err(value_error)?;
        let n_strings = start.len();
        Ok(TrackedArrays {
            allocated_kw: vector(py, kilowatts(tracked.allocated_w)),
            delivered_kw: vector(py, kilowatts(tracked.delivered_w)),
            request_kw: matrix(py, n_strings, kilowatts(tracked.request_w)),
            soc: matrix(py, n_strings, tracked.soc),
            temperature_c: matrix(py, n_strings, tracked.temperature_c),
        })
    }

    /// Open-circuit voltage [V] and resistance [Ohm] of every string at states `(M, N)` in one direction.
    fn coefficients(
        &self,
        py: Python<'_>,
        soc: MatrixIn<'_>,
        temperature_c: MatrixIn<'_>,
        discharge: bool,
    ) -> PyResult<(Matrix, Matrix)> {
        let (n_strings, shape) = (self.inner.strings().len(), soc.shape());
        check_shape("soc", &[n_strings, shape[1]], shape)?;
        check_shape("temperature_c", shape, temperature_c.shape())?;
        let direction = direction(discharge);
        let (soc, temperature_c) = (soc.as_array(), temperature_c.as_array());
        let at = |(((m, _), &soc), &temperature_c): (((usize, usize), &f64), &f64)| {
            let state = StringState { soc, temperature_c };
            let c = self.inner.strings()[m].coefficients(direction, state);
            (c.voltage_v, c.resistance_ohm)
        };
        let (voltage_v, resistance_ohm) = soc.indexed_iter().zip(&temperature_c).map(at).unzip();
        Ok((matrix(py, n_strings, voltage_v), matrix(py, n_strings, resistance_ohm)))
    }

    /// Maximum AC power of each string over the next interval, before derating `(M,)` [kW].
    fn deliverable_kw(
        &self,
        py: Python<'_>,
        soc: VectorIn<'_>,
        temperature_c: VectorIn<'_>,
        discharge: bool,
        dt_h: f64,
    ) -> PyResult<Vector> {
        let states = self.states(&soc, &temperature_c)?;
        Ok(vector(py, kilowatts(self.inner.deliverable_w(&states, direction(discharge), dt_h))))
    }

    /// Requests `(M,)` [kW, magnitudes] of one step, each 0 or at least the minimum power of its inverter,
    /// and at most its limit `(M,)`. Their sum is kept if possible.
    fn set_points(
        &self,
        py: Python<'_>,
        request_kw: VectorIn<'_>,
        limit_kw: VectorIn<'_>,
    ) -> PyResult<Vector> {
        let shape = [self.inner.strings().len()];
        check_shape("request", &shape, request_kw.shape())?;
        check_shape("limit", &shape, limit_kw.shape())?;
        let mut request_w = watts(&request_kw);
        self.inner.set_points(&mut request_w, &watts(&limit_kw));
        Ok(vector(py, kilowatts(request_w)))
    }

    /// Allocates a total reactive power of equal sign to the strings `(M,)` [kvar], at minimum loss with signed requests `(M,)`
    /// [kW], within `limit_kva` `(M,)`; the start of an inverter costs `start_kw` `(M,)`.
    fn share_reactive(
        &self,
        py: Python<'_>,
        request_kw: VectorIn<'_>,
        total_kvar: f64,
        limit_kva: VectorIn<'_>,
        start_kw: VectorIn<'_>,
    ) -> PyResult<Vector> {
        let (request_w, limit_va, start_w) = (watts(&request_kw), watts(&limit_kva), watts(&start_kw));
        let total_var = total_kvar.abs() * W_PER_KW;
        let shares = py
            .detach(|| self.inner.share_reactive(&request_w, total_var, &limit_va, &start_w))
            .map_err(value_error)?;
        let unit = if total_kvar < 0.0 { -W_PER_KW } else { W_PER_KW };
        Ok(vector(py, shares.into_iter().map(|q| q / unit).collect()))
    }

    /// Constants of normalisation of each string [kW]: inverter loss at `p_N` in charge, and `h_N`.
    fn nominal_loss_kw(&self, py: Python<'_>) -> (Vector, Vector) {
        let (inverter_w, battery_w) = self.inner.nominal_losses_w();
        (vector(py, kilowatts(inverter_w)), vector(py, kilowatts(battery_w)))
    }
}

/// Allocation of plant powers to strings `(P, M)` [kW], in charge and in discharge, at uniform powers from
/// zero to the sum of `limit_kw` `(M,)`.
#[pyclass(frozen, module = "bess._core")]
pub struct BestShares {
    pub(crate) inner: bess_control::BestShares,
}

#[pymethods]
impl BestShares {
    #[new]
    fn new(charge_kw: MatrixIn<'_>, discharge_kw: MatrixIn<'_>, limit_kw: VectorIn<'_>) -> PyResult<Self> {
        check_shape("charge", &[charge_kw.shape()[0], limit_kw.len()], charge_kw.shape())?;
        check_shape("discharge", charge_kw.shape(), discharge_kw.shape())?;
        let inner = bess_control::BestShares::new(watts(&charge_kw), watts(&discharge_kw), watts(&limit_kw));
        Ok(Self { inner: inner.map_err(value_error)? })
    }
}

/// Result of tracking: allocated and delivered power `(T,)`, requests of the strings `(M, T)` [kW, positive =
/// discharge], and the states at the start and at the end of each step `(M, T + 1)`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct TrackedArrays {
    allocated_kw: Vector,
    delivered_kw: Vector,
    request_kw: Matrix,
    soc: Matrix,
    temperature_c: Matrix,
}
