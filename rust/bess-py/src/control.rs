use bess_control::{ControlError, Problem, Range, Rollouts, StateBox};
use bess_tables::Direction;
use numpy::ndarray::{Array1, Array2, Array3, ArrayView};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::system::System;

const W_PER_KW: f64 = 1e3;

type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type Cube<'py> = Bound<'py, PyArray3<f64>>;

fn refused(error: ControlError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn flat<D: numpy::ndarray::Dimension>(array: ArrayView<'_, f64, D>, factor: f64) -> Vec<f64> {
    array.iter().map(|v| v * factor).collect()
}

fn matrix<'py>(py: Python<'py>, rows: usize, columns: usize, values: Vec<f64>) -> Matrix<'py> {
    Array2::from_shape_vec((rows, columns), values).expect("one value for each entry").into_pyarray(py)
}

fn shape_error(name: &str, needed: &[usize], given: &[usize]) -> PyErr {
    PyValueError::new_err(format!("{name}: needs shape {needed:?}, has {given:?}"))
}

/// Control model of a plant (MODEL.md section 3).
#[pyclass(frozen, module = "bess._core")]
pub struct ControlModel {
    inner: bess_control::ControlModel,
}

#[pymethods]
impl ControlModel {
    #[new]
    fn new(system: &System) -> Self {
        Self { inner: bess_control::ControlModel::new(&system.inner) }
    }

    /// Rolls out signed requests `(B, M, T)` [kW]. Eight arrays `(B, M, T)`: delivered [kW, signed], availability,
    /// derating, inverter and battery loss [kW], current [A, signed], SOC and temperature at the end of the step.
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        soc0: PyReadonlyArray1<'py, f64>,
        temperature0_c: PyReadonlyArray1<'py, f64>,
        request_kw: PyReadonlyArray3<'py, f64>,
        ambient_c: PyReadonlyArray1<'py, f64>,
        dt_h: f64,
    ) -> PyResult<[Cube<'py>; 8]> {
        let (soc, temperature_c) = (flat(soc0.as_array(), 1.0), flat(temperature0_c.as_array(), 1.0));
        let ambient_c = flat(ambient_c.as_array(), 1.0);
        let view = request_kw.as_array();
        let shape = view.dim();
        if shape.1 != self.inner.strings().len() || shape.2 != ambient_c.len() {
            let needed = [shape.0, self.inner.strings().len(), ambient_c.len()];
            return Err(shape_error("request", &needed, view.shape()));
        }
        let requests_w = flat(view, W_PER_KW);
        let out: Rollouts = py
            .detach(|| {
                let start = self.inner.states(&soc, &temperature_c)?;
                self.inner.rollout(&start, &requests_w, &ambient_c, dt_h)
            })
            .map_err(refused)?;
        let cube = |values: Vec<f64>, unit: f64| {
            let scaled = values.into_iter().map(|v| v / unit).collect();
            Array3::from_shape_vec(shape, scaled).expect("one value for each request").into_pyarray(py)
        };
        Ok([
            cube(out.delivered_w, W_PER_KW),
            cube(out.availability_w, W_PER_KW),
            cube(out.derating_w, W_PER_KW),
            cube(out.inverter_w, W_PER_KW),
            cube(out.battery_w, W_PER_KW),
            cube(out.current_a, 1.0),
            cube(out.soc, 1.0),
            cube(out.temperature_c, 1.0),
        ])
    }

    /// Largest AC power of each string over the next interval, before derating `(M,)` [kW].
    fn max_power_kw<'py>(
        &self,
        py: Python<'py>,
        soc0: PyReadonlyArray1<'py, f64>,
        temperature0_c: PyReadonlyArray1<'py, f64>,
        discharge: bool,
        dt_h: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (soc, temperature_c) = (flat(soc0.as_array(), 1.0), flat(temperature0_c.as_array(), 1.0));
        let states = self.inner.states(&soc, &temperature_c).map_err(refused)?;
        let direction = if discharge { Direction::Discharge } else { Direction::Charge };
        let limits = self.inner.limits_w(&states, direction, dt_h);
        Ok(limits.into_iter().map(|p| p / W_PER_KW).collect::<Array1<f64>>().into_pyarray(py))
    }

    /// Constants of normalisation of each string [kW]: inverter loss at `p_N` in charge, and `h_N`.
    #[allow(clippy::type_complexity)]
    fn nominal_loss_kw<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
        let (inverter, battery) = self.inner.nominal_losses_w();
        let kw = |values: Vec<f64>| values.into_iter().map(|p| p / W_PER_KW).collect::<Array1<f64>>();
        (kw(inverter).into_pyarray(py), kw(battery).into_pyarray(py))
    }
}

/// One split problem on the control model. Requests are signed as the demand is; limits are magnitudes.
#[pyclass(frozen, module = "bess._core")]
pub struct ControlHorizon {
    inner: bess_control::ControlHorizon,
}

impl ControlHorizon {
    /// Requests `(B, M, T)` [kW] as checked magnitudes [W].
    fn requests(&self, name: &str, request_kw: &PyReadonlyArray3<'_, f64>) -> PyResult<Vec<f64>> {
        let view = request_kw.as_array();
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        if view.shape()[1..] != [n_strings, n_steps] {
            return Err(shape_error(name, &[view.shape()[0], n_strings, n_steps], view.shape()));
        }
        self.inner.magnitudes(&flat(view, W_PER_KW)).map_err(refused)
    }

    /// The request as it leaves, in kW, and the objectives of exactly that request.
    fn schedule<'py>(
        &self,
        py: Python<'py>,
        request_w: &[f64],
    ) -> PyResult<(Matrix<'py>, Bound<'py, PyArray1<f64>>)> {
        let request_kw: Vec<f64> = self.inner.signed(request_w).into_iter().map(|p| p / W_PER_KW).collect();
        let rounded: Vec<f64> = request_kw.iter().map(|p| p * W_PER_KW).collect();
        let objectives = self.inner.evaluate(&self.inner.magnitudes(&rounded).map_err(refused)?);
        let request = matrix(py, self.inner.n_strings(), self.inner.n_steps(), request_kw);
        Ok((request, Array1::from_vec(objectives).into_pyarray(py)))
    }

    fn boxes(
        &self,
        soc_low: &PyReadonlyArray2<'_, f64>,
        soc_high: &PyReadonlyArray2<'_, f64>,
        temperature_low_c: &PyReadonlyArray2<'_, f64>,
        temperature_high_c: &PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Vec<StateBox>> {
        let shape = [self.inner.n_strings(), self.inner.n_steps()];
        let arrays = [soc_low, soc_high, temperature_low_c, temperature_high_c];
        for array in arrays {
            if array.as_array().shape() != shape {
                return Err(shape_error("states", &shape, array.as_array().shape()));
            }
        }
        let [soc_low, soc_high, t_low, t_high] = arrays.map(|array| flat(array.as_array(), 1.0));
        (0..soc_low.len())
            .map(|i| {
                let soc = Range { low: soc_low[i], high: soc_high[i] };
                let temperature_c = Range { low: t_low[i], high: t_high[i] };
                if soc.low <= soc.high && temperature_c.low <= temperature_c.high {
                    Ok(StateBox { soc, temperature_c })
                } else {
                    Err(PyValueError::new_err(format!("states: empty box or NaN at position {i}")))
                }
            })
            .collect()
    }
}

#[pymethods]
impl ControlHorizon {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        system: &System,
        soc0: PyReadonlyArray1<'_, f64>,
        temperature0_c: PyReadonlyArray1<'_, f64>,
        demand_kw: PyReadonlyArray1<'_, f64>,
        ambient_c: PyReadonlyArray1<'_, f64>,
        dt_h: f64,
        limit_kw: PyReadonlyArray2<'_, f64>,
        costs: PyReadonlyArray3<'_, f64>,
        tol_abs: PyReadonlyArray1<'_, f64>,
        tol_rel: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let model = bess_control::ControlModel::new(&system.inner);
        let needed = [model.strings().len(), demand_kw.as_array().len()];
        if limit_kw.as_array().shape() != needed {
            return Err(shape_error("limit", &needed, limit_kw.as_array().shape()));
        }
        let needed = [tol_abs.as_array().len(), model.strings().len(), 4];
        if costs.as_array().shape() != needed {
            return Err(shape_error("costs", &needed, costs.as_array().shape()));
        }
        let problem = Problem {
            soc: &flat(soc0.as_array(), 1.0),
            temperature_c: &flat(temperature0_c.as_array(), 1.0),
            demand_w: &flat(demand_kw.as_array(), W_PER_KW),
            ambient_c: &flat(ambient_c.as_array(), 1.0),
            dt_h,
            limit_w: &flat(limit_kw.as_array(), W_PER_KW),
            costs: &flat(costs.as_array(), 1.0 / W_PER_KW),
            tolerance_abs: &flat(tol_abs.as_array(), 1.0),
            tolerance_rel: &flat(tol_rel.as_array(), 1.0),
        };
        Ok(Self { inner: bess_control::ControlHorizon::new(model, &problem).map_err(refused)? })
    }

    /// Group objectives `(B, G)` of requests `(B, M, T)` [kW].
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        request_kw: PyReadonlyArray3<'py, f64>,
    ) -> PyResult<Matrix<'py>> {
        let requests_w = self.requests("request", &request_kw)?;
        let values = py.detach(|| self.inner.evaluate(&requests_w));
        Ok(matrix(py, request_kw.as_array().shape()[0], self.inner.n_groups(), values))
    }

    /// Each step's optimum at the state reached: request `(M, T)` [kW] and objectives `(G,)`.
    fn greedy<'py>(&self, py: Python<'py>) -> PyResult<(Matrix<'py>, Bound<'py, PyArray1<f64>>)> {
        let best = py.detach(|| self.inner.greedy());
        self.schedule(py, &best.request_w)
    }

    /// Local search from `(B, M, T)` [kW]: request `(M, T)`, objectives `(G,)`, roll-outs used.
    fn search<'py>(
        &self,
        py: Python<'py>,
        starts_kw: PyReadonlyArray3<'py, f64>,
        max_rollouts: usize,
    ) -> PyResult<(Matrix<'py>, Bound<'py, PyArray1<f64>>, usize)> {
        let starts_w = self.requests("starts", &starts_kw)?;
        if starts_w.is_empty() {
            return Err(PyValueError::new_err("starts: give at least one schedule"));
        }
        let (best, used) = py.detach(|| self.inner.search(&starts_w, max_rollouts));
        let (request, objectives) = self.schedule(py, &best.request_w)?;
        Ok((request, objectives, used))
    }

    /// Bounds of all reachable states, `(M, T + 1)`: SOC low and high, temperature low and high [degC].
    fn reachable<'py>(&self, py: Python<'py>) -> [Matrix<'py>; 4] {
        let boxes = py.detach(|| self.inner.reachable());
        let pick = |f: fn(&StateBox) -> f64| {
            matrix(py, self.inner.n_strings(), self.inner.n_steps() + 1, boxes.iter().map(f).collect())
        };
        [
            pick(|b| b.soc.low),
            pick(|b| b.soc.high),
            pick(|b| b.temperature_c.low),
            pick(|b| b.temperature_c.high),
        ]
    }

    /// Step cuts over boxes of states `(M, T)`: `phi (G, T)` and what a shed kW may save `(G, T)` [1/kW].
    fn step_bounds<'py>(
        &self,
        py: Python<'py>,
        soc_low: PyReadonlyArray2<'py, f64>,
        soc_high: PyReadonlyArray2<'py, f64>,
        temperature_low_c: PyReadonlyArray2<'py, f64>,
        temperature_high_c: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Matrix<'py>; 2]> {
        let boxes = self.boxes(&soc_low, &soc_high, &temperature_low_c, &temperature_high_c)?;
        let bounds = py.detach(|| self.inner.step_bounds(&boxes));
        let shape = (self.inner.n_groups(), self.inner.n_steps());
        let phi = bounds.iter().map(|b| b.phi).collect();
        let slope = bounds.iter().map(|b| b.shed_slope * W_PER_KW).collect();
        Ok([matrix(py, shape.0, shape.1, phi), matrix(py, shape.0, shape.1, slope)])
    }

    /// `k`, `V` [V] and `R` [Ohm] at states `(M, T)`, each in the direction of its step.
    fn coefficients<'py>(
        &self,
        py: Python<'py>,
        soc: PyReadonlyArray2<'py, f64>,
        temperature_c: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Matrix<'py>; 3]> {
        let boxes = self.boxes(&soc, &soc, &temperature_c, &temperature_c)?;
        let ranges = self.inner.ranges(&boxes);
        let (rows, columns) = (self.inner.n_strings(), self.inner.n_steps());
        Ok([
            matrix(py, rows, columns, ranges.iter().map(|r| r.derating.low).collect()),
            matrix(py, rows, columns, ranges.iter().map(|r| r.voltage_v.low).collect()),
            matrix(py, rows, columns, ranges.iter().map(|r| r.resistance_ohm.low).collect()),
        ])
    }

    /// Low and high of `k`, `V` [V], `R` [Ohm] and `V^2 / R` [kW] over boxes of states: eight arrays `(M, T)`.
    fn ranges<'py>(
        &self,
        py: Python<'py>,
        soc_low: PyReadonlyArray2<'py, f64>,
        soc_high: PyReadonlyArray2<'py, f64>,
        temperature_low_c: PyReadonlyArray2<'py, f64>,
        temperature_high_c: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Matrix<'py>; 8]> {
        let boxes = self.boxes(&soc_low, &soc_high, &temperature_low_c, &temperature_high_c)?;
        let ranges = self.inner.ranges(&boxes);
        let (rows, columns) = (self.inner.n_strings(), self.inner.n_steps());
        let pick = |end: &dyn Fn(&bess_control::CoefficientRanges) -> f64| {
            matrix(py, rows, columns, ranges.iter().map(end).collect())
        };
        Ok([
            pick(&|r| r.derating.low),
            pick(&|r| r.derating.high),
            pick(&|r| r.voltage_v.low),
            pick(&|r| r.voltage_v.high),
            pick(&|r| r.resistance_ohm.low),
            pick(&|r| r.resistance_ohm.high),
            pick(&|r| r.power_scale_w.low / W_PER_KW),
            pick(&|r| r.power_scale_w.high / W_PER_KW),
        ])
    }

    /// Planes over boxes of states: `V^2 / R <= y0 + y1 soc + y2 tau` [kW] and `1 - k >= g0 + g1 tau`: five arrays `(M, T)`.
    fn planes<'py>(
        &self,
        py: Python<'py>,
        soc_low: PyReadonlyArray2<'py, f64>,
        soc_high: PyReadonlyArray2<'py, f64>,
        temperature_low_c: PyReadonlyArray2<'py, f64>,
        temperature_high_c: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Matrix<'py>; 5]> {
        let boxes = self.boxes(&soc_low, &soc_high, &temperature_low_c, &temperature_high_c)?;
        let planes = self.inner.planes(&boxes);
        let (rows, columns) = (self.inner.n_strings(), self.inner.n_steps());
        let pick = |value: &dyn Fn(&bess_control::Planes) -> f64| {
            matrix(py, rows, columns, planes.iter().map(value).collect())
        };
        Ok([
            pick(&|p| p.power_scale_w / W_PER_KW),
            pick(&|p| p.power_scale_per_soc / W_PER_KW),
            pick(&|p| p.power_scale_per_k / W_PER_KW),
            pick(&|p| p.derated),
            pick(&|p| p.derated_per_k),
        ])
    }
}
