use bess_control::{ControlError, LossCosts, Problem, Range, Rollouts, StateBox, StringState};
use bess_tables::Direction;
use numpy::ndarray::{Array1, Array2, Array3, ArrayView};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::system::System;

const W_PER_KW: f64 = 1e3;

type Vector<'py> = Bound<'py, PyArray1<f64>>;
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

/// Boxes of states from four arrays of one shape: low and high of SOC and of temperature.
fn boxes(shape: [usize; 2], arrays: [&PyReadonlyArray2<'_, f64>; 4]) -> PyResult<Vec<StateBox>> {
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

/// The same four arrays from boxes.
fn box_arrays<'py>(py: Python<'py>, boxes: &[StateBox], n_strings: usize) -> [Matrix<'py>; 4] {
    let pick = |f: fn(&StateBox) -> f64| {
        matrix(py, n_strings, boxes.len() / n_strings, boxes.iter().map(f).collect())
    };
    [pick(|b| b.soc.low), pick(|b| b.soc.high), pick(|b| b.temperature_c.low), pick(|b| b.temperature_c.high)]
}

/// Costs of the losses of each string [1/W] from an array `(M, 4)` [1/kW].
fn loss_costs(costs: &PyReadonlyArray2<'_, f64>, n_strings: usize) -> PyResult<Vec<LossCosts>> {
    let costs = costs.as_array();
    if costs.shape() != [n_strings, 4] {
        return Err(shape_error("costs", &[n_strings, 4], costs.shape()));
    }
    Ok(flat(costs, 1.0 / W_PER_KW).chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect())
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

    /// Boxes of the states at the start of each step.
    fn boxes(&self, arrays: [&PyReadonlyArray2<'_, f64>; 4]) -> PyResult<Vec<StateBox>> {
        boxes([self.inner.n_strings(), self.inner.n_steps()], arrays)
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

    /// Minimises one group from `(1, M, T)` [kW] under the ceilings of those before it: request `(M, T)`, objectives
    /// `(G,)`, roll-outs used.
    fn descend<'py>(
        &self,
        py: Python<'py>,
        start_kw: PyReadonlyArray3<'py, f64>,
        group: usize,
        ceilings: PyReadonlyArray1<'py, f64>,
        max_rollouts: usize,
    ) -> PyResult<(Matrix<'py>, Bound<'py, PyArray1<f64>>, usize)> {
        let ceilings = flat(ceilings.as_array(), 1.0);
        if group >= self.inner.n_groups() || ceilings.len() < group {
            let n_groups = self.inner.n_groups();
            return Err(PyValueError::new_err(format!(
                "group {group} of {n_groups} needs the ceilings of all groups before it, not {}",
                ceilings.len()
            )));
        }
        let start_w = self.requests("start", &start_kw)?;
        if start_kw.as_array().shape()[0] != 1 {
            return Err(PyValueError::new_err("start: give one schedule"));
        }
        let (best, used) = py.detach(|| self.inner.descend(&start_w, group, &ceilings, max_rollouts));
        let (request, objectives) = self.schedule(py, &best.request_w)?;
        Ok((request, objectives, used))
    }

    /// Bounds of all reachable states, `(M, T + 1)`: SOC low and high, temperature low and high [degC].
    fn reachable<'py>(&self, py: Python<'py>) -> [Matrix<'py>; 4] {
        let boxes = py.detach(|| self.inner.reachable());
        box_arrays(py, &boxes, self.inner.n_strings())
    }

    /// Step cuts of one objective over boxes of states `(M, T)`, with costs of the losses `(M, 4)` [1/kW]: `phi (T,)` and
    /// what a shed kW may save `(T,)` [1/kW], the best if at most `budget_kw` `(T,)` is shed in a step; and the best requests of
    /// each step if nothing is, `(M, T)` [kW, signed].
    #[allow(clippy::too_many_arguments)]
    fn step_bounds<'py>(
        &self,
        py: Python<'py>,
        soc_low: PyReadonlyArray2<'py, f64>,
        soc_high: PyReadonlyArray2<'py, f64>,
        temperature_low_c: PyReadonlyArray2<'py, f64>,
        temperature_high_c: PyReadonlyArray2<'py, f64>,
        costs: PyReadonlyArray2<'py, f64>,
        budget_kw: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(Vector<'py>, Vector<'py>, Matrix<'py>)> {
        let boxes = self.boxes([&soc_low, &soc_high, &temperature_low_c, &temperature_high_c])?;
        let costs = loss_costs(&costs, self.inner.n_strings())?;
        let budget_w = flat(budget_kw.as_array(), W_PER_KW);
        let answer = py.detach(|| self.inner.step_bounds(&boxes, &costs, &budget_w)).map_err(refused)?;
        let phi: Vec<f64> = answer.bounds.iter().map(|b| b.phi).collect();
        let slope: Vec<f64> = answer.bounds.iter().map(|b| b.shed_slope * W_PER_KW).collect();
        let request = self.inner.signed(&answer.request_w).iter().map(|u| u / W_PER_KW).collect();
        Ok((
            Array1::from_vec(phi).into_pyarray(py),
            Array1::from_vec(slope).into_pyarray(py),
            matrix(py, self.inner.n_strings(), self.inner.n_steps(), request),
        ))
    }

    /// Bounds the cost of every schedule, given costs of the losses `(M, 4)` [1/kW], and the states of those that cost no
    /// more than `request_kw` `(M, T)` and shed at most `shed_budget_kw` in all: the bound, and boxes like `reachable`.
    fn confine<'py>(
        &self,
        py: Python<'py>,
        request_kw: PyReadonlyArray2<'py, f64>,
        costs: PyReadonlyArray2<'py, f64>,
        shed_budget_kw: f64,
    ) -> PyResult<(f64, [Matrix<'py>; 4])> {
        let shape = [self.inner.n_strings(), self.inner.n_steps()];
        if request_kw.as_array().shape() != shape {
            return Err(shape_error("request", &shape, request_kw.as_array().shape()));
        }
        let request_w = self.inner.magnitudes(&flat(request_kw.as_array(), W_PER_KW)).map_err(refused)?;
        let costs = loss_costs(&costs, shape[0])?;
        let answer = py
            .detach(|| self.inner.confine(&request_w, &costs, shed_budget_kw * W_PER_KW))
            .map_err(refused)?;
        Ok((answer.bound, box_arrays(py, &answer.boxes, shape[0])))
    }

    /// `k`, `V` [V] and `R` [Ohm] at states `(M, T)`, each in the direction of its step.
    fn coefficients<'py>(
        &self,
        py: Python<'py>,
        soc: PyReadonlyArray2<'py, f64>,
        temperature_c: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Matrix<'py>; 3]> {
        let boxes = self.boxes([&soc, &soc, &temperature_c, &temperature_c])?;
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
        let boxes = self.boxes([&soc_low, &soc_high, &temperature_low_c, &temperature_high_c])?;
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

    /// Planes over boxes of states: `V^2 / R <= y0 + y1 soc + y2 tau` [kW] and `1 - k >= g0 + g1 tau`: five arrays
    /// `(M, T)`, closest at the given states.
    #[allow(clippy::too_many_arguments)]
    fn planes<'py>(
        &self,
        py: Python<'py>,
        soc_low: PyReadonlyArray2<'py, f64>,
        soc_high: PyReadonlyArray2<'py, f64>,
        temperature_low_c: PyReadonlyArray2<'py, f64>,
        temperature_high_c: PyReadonlyArray2<'py, f64>,
        soc: PyReadonlyArray2<'py, f64>,
        temperature_c: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Matrix<'py>; 5]> {
        let boxes = self.boxes([&soc_low, &soc_high, &temperature_low_c, &temperature_high_c])?;
        let points = self.boxes([&soc, &soc, &temperature_c, &temperature_c])?;
        let state = |b: &StateBox| StringState { soc: b.soc.low, temperature_c: b.temperature_c.low };
        let at: Vec<_> = points.iter().map(state).collect();
        let planes = self.inner.planes(&boxes, &at);
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
