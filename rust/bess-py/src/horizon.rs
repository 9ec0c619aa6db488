use std::time::{Duration, Instant};

use bess_control::{CoefficientRanges, Effort, Losses, Planes, Problem, StateBox, StringState};
use bess_tables::units::W_PER_KW;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{check_shape, flags, flat, matrix, refused, vector, Flags, Matrix, Vector};
use crate::model::{ControlModel, FlowArrays};
use crate::states::StateBoxes;

/// The best schedule of a search so far.
#[pyclass(frozen, module = "bess._core")]
pub struct Incumbent {
    inner: bess_control::Incumbent,
    request_kw: Matrix,
    objectives: Vector,
}

#[pymethods]
impl Incumbent {
    /// Requests `(M, T)` [kW, signed].
    #[getter]
    fn request_kw(&self, py: Python<'_>) -> Matrix {
        self.request_kw.clone_ref(py)
    }

    /// Objectives of the groups in the costs of the search `(G,)`.
    #[getter]
    fn objectives(&self, py: Python<'_>) -> Vector {
        self.objectives.clone_ref(py)
    }
}

/// Objective and bounds of one group.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct GroupBounds {
    /// In the costs of what is reported.
    objective: f64,
    /// What it may rise to while later groups are minimised.
    ceiling: f64,
    /// Lower bound of the nonlinear control model.
    bound: f64,
    /// In the costs of the search.
    search_objective: f64,
    search_ceiling: f64,
    /// Lower bound of the convexified program, with coefficients frozen along the schedule.
    search_bound: f64,
    /// Whether that is its optimum.
    is_search_optimum: bool,
    /// States of the schedules that are no worse `(M, T + 1)`; None where the bound needed none.
    boxes: Option<Py<StateBoxes>>,
    /// Whether one of them sheds something `(M, T)`.
    may_shed: Option<Flags>,
}

/// The best schedule found, what it does, and the bounds of each group.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct SplitAnswer {
    incumbent: Py<Incumbent>,
    flows: Py<FlowArrays>,
    groups: Vec<Py<GroupBounds>>,
    rollouts: usize,
}

/// Bound of a group, and the states of the schedules that are no worse than a given one.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct Confined {
    bound: f64,
    boxes: Py<StateBoxes>,
    may_shed: Flags,
}

/// Step cuts `cost + shed_slope shed >= phi`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct StepCuts {
    /// `(T,)`
    phi: Vector,
    /// What a shed kW may save `(T,)` [1/kW].
    shed_slope: Vector,
    /// Best requests of each step if nothing is shed `(M, T)` [kW, signed].
    request_kw: Matrix,
}

/// Coefficients over boxes of states, each `(M, T)`, in the direction of the step.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct CoefficientBounds {
    derating_low: Matrix,
    derating_high: Matrix,
    voltage_low_v: Matrix,
    voltage_high_v: Matrix,
    resistance_low_ohm: Matrix,
    resistance_high_ohm: Matrix,
    /// `V^2 / R`.
    power_scale_low_kw: Matrix,
    power_scale_high_kw: Matrix,
    /// `V^2 / R <= plane_kw + plane_per_soc_kw soc + plane_per_k_kw tau`.
    plane_kw: Matrix,
    plane_per_soc_kw: Matrix,
    plane_per_k_kw: Matrix,
    /// `1 - k >= derated + derated_per_k tau`.
    derated: Matrix,
    derated_per_k: Matrix,
}

/// One split problem on the control model. Requests are signed as the demand is; limits are magnitudes.
#[pyclass(frozen, module = "bess._core")]
pub struct ControlHorizon {
    inner: bess_control::ControlHorizon,
}

impl ControlHorizon {
    /// Requests `(B, M, T)` [kW] as checked magnitudes [W].
    fn magnitudes(&self, name: &str, request_kw: &PyReadonlyArray3<'_, f64>) -> PyResult<Vec<f64>> {
        let shape = request_kw.shape();
        check_shape(name, &[shape[0], self.inner.n_strings(), self.inner.n_steps()], shape)?;
        self.inner.magnitudes(&flat(request_kw.as_array(), W_PER_KW)).map_err(refused)
    }

    fn signed_kw(&self, py: Python<'_>, request_w: &[f64]) -> Matrix {
        let kw = self.inner.signed(request_w).into_iter().map(|p| p / W_PER_KW).collect();
        matrix(py, self.inner.n_strings(), kw)
    }

    fn incumbent(&self, py: Python<'_>, inner: bess_control::Incumbent) -> Incumbent {
        let request_kw = self.signed_kw(py, &inner.schedule.request_w);
        let objectives = vector(py, inner.schedule.objectives[..self.inner.n_groups()].to_vec());
        Incumbent { inner, request_kw, objectives }
    }

    /// Costs of the losses of each string [1/W] from an array `(M, 4)` [1/kW].
    fn loss_costs(&self, costs: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Losses>> {
        check_shape("costs", &[self.inner.n_strings(), 4], costs.shape())?;
        let flat = flat(costs.as_array(), 1.0 / W_PER_KW);
        Ok(flat.chunks_exact(4).map(|c| Losses::from_array([c[0], c[1], c[2], c[3]])).collect())
    }

    fn boxes(&self, boxes: Vec<StateBox>) -> StateBoxes {
        StateBoxes { n_strings: self.inner.n_strings(), boxes }
    }
}

#[pymethods]
impl ControlHorizon {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        model: &ControlModel,
        soc0: PyReadonlyArray1<'_, f64>,
        temperature0_c: PyReadonlyArray1<'_, f64>,
        demand_kw: PyReadonlyArray1<'_, f64>,
        ambient_c: PyReadonlyArray1<'_, f64>,
        dt_h: f64,
        limit_kw: PyReadonlyArray2<'_, f64>,
        costs: PyReadonlyArray3<'_, f64>,
        search_costs: PyReadonlyArray3<'_, f64>,
        tol_abs: PyReadonlyArray1<'_, f64>,
        tol_rel: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let n_strings = model.inner.strings().len();
        check_shape("limit", &[n_strings, demand_kw.len()], limit_kw.shape())?;
        for costs in [&costs, &search_costs] {
            check_shape("costs", &[tol_abs.len(), n_strings, 4], costs.shape())?;
        }
        let problem = Problem {
            soc: &flat(soc0.as_array(), 1.0),
            temperature_c: &flat(temperature0_c.as_array(), 1.0),
            demand_w: &flat(demand_kw.as_array(), W_PER_KW),
            ambient_c: &flat(ambient_c.as_array(), 1.0),
            dt_h,
            limit_w: &flat(limit_kw.as_array(), W_PER_KW),
            costs: &flat(costs.as_array(), 1.0 / W_PER_KW),
            search_costs: &flat(search_costs.as_array(), 1.0 / W_PER_KW),
            tolerance_abs: &flat(tol_abs.as_array(), 1.0),
            tolerance_rel: &flat(tol_rel.as_array(), 1.0),
        };
        Ok(Self { inner: bess_control::ControlHorizon::new(model.inner.clone(), &problem).map_err(refused)? })
    }

    /// Searches for the best schedule, from requests `(M, T)` [kW, of any sign] if given, and bounds what it found.
    /// `rollouts` is the effort of one descent; after `time_limit_s` the best known is returned.
    #[pyo3(signature = (warm_start_kw, rollouts, time_limit_s=None))]
    fn split(
        &self,
        py: Python<'_>,
        warm_start_kw: Option<PyReadonlyArray2<'_, f64>>,
        rollouts: usize,
        time_limit_s: Option<f64>,
    ) -> PyResult<SplitAnswer> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let warm_start_w = match &warm_start_kw {
            None => None,
            Some(array) => {
                check_shape("warm_start", &[n_strings, n_steps], array.shape())?;
                let given = flat(array.as_array(), W_PER_KW);
                // What points against the demand of its step says nothing about it.
                Some(self.inner.signed(&given).into_iter().map(|p| p.max(0.0)).collect::<Vec<_>>())
            }
        };
        let deadline = time_limit_s
            .and_then(|s| Instant::now().checked_add(Duration::try_from_secs_f64(s.max(0.0)).ok()?));
        let effort = Effort { rollouts, deadline };
        let answer = py.detach(|| self.inner.split(warm_start_w.as_deref(), &effort));
        let signs: Vec<f64> = self.inner.signed(&vec![1.0; n_steps]);
        let group = |group: bess_control::GroupBounds| -> PyResult<Py<GroupBounds>> {
            let boxes = match group.boxes.is_empty() {
                true => None,
                false => Some(Py::new(py, self.boxes(group.boxes))?),
            };
            let may_shed = boxes.as_ref().map(|_| flags(py, n_strings, group.may_shed));
            Py::new(
                py,
                GroupBounds {
                    objective: group.objective,
                    ceiling: group.ceiling,
                    bound: group.bound,
                    search_objective: group.search_objective,
                    search_ceiling: group.search_ceiling,
                    search_bound: group.search_bound,
                    is_search_optimum: group.is_search_optimum,
                    boxes,
                    may_shed,
                },
            )
        };
        Ok(SplitAnswer {
            incumbent: Py::new(py, self.incumbent(py, answer.incumbent))?,
            flows: Py::new(py, FlowArrays::new(py, &answer.flows, &signs))?,
            groups: answer.groups.into_iter().map(group).collect::<PyResult<_>>()?,
            rollouts: answer.rollouts,
        })
    }

    /// The best of requests in the proportions of `wanted_kw` `(B, M, T)`, `>= 0`, that meet the demand; None where the
    /// incumbent is as good.
    fn best_of(
        &self,
        py: Python<'_>,
        incumbent: &Incumbent,
        wanted_kw: PyReadonlyArray3<'_, f64>,
    ) -> PyResult<Option<Incumbent>> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let shape = wanted_kw.shape();
        check_shape("wanted", &[shape[0], n_strings, n_steps], shape)?;
        let wanted = flat(wanted_kw.as_array(), 1.0);
        if wanted.iter().any(|w| !(*w >= 0.0 && w.is_finite())) {
            return Err(PyValueError::new_err("wanted: every value must be finite and >= 0"));
        }
        let (mut best, mut is_better) = (incumbent.inner.clone(), false);
        for wanted in wanted.chunks_exact((n_strings * n_steps).max(1)) {
            is_better |= best.offer(&self.inner, self.inner.rated(self.inner.fitted(wanted)));
        }
        Ok(is_better.then(|| self.incumbent(py, best)))
    }

    /// Group objectives in the costs of the search `(B, G)` of requests `(B, M, T)` [kW].
    fn evaluate(&self, py: Python<'_>, request_kw: PyReadonlyArray3<'_, f64>) -> PyResult<Matrix> {
        let requests_w = self.magnitudes("request", &request_kw)?;
        let values = py.detach(|| self.inner.evaluate(&requests_w));
        Ok(matrix(py, request_kw.shape()[0], values))
    }

    /// Each step's optimum at the state reached, `(M, T)` [kW, signed].
    fn greedy(&self, py: Python<'_>) -> Matrix {
        let best = py.detach(|| self.inner.greedy());
        self.signed_kw(py, &best.request_w)
    }

    /// All reachable states `(M, T + 1)`.
    fn reachable(&self, py: Python<'_>) -> StateBoxes {
        self.boxes(py.detach(|| self.inner.reachable()))
    }

    /// Step cuts of one objective over boxes of states, with costs of the losses `(M, 4)` [1/kW]; the best if at most
    /// `budget_kw` `(T,)` is shed in a step.
    fn step_bounds(
        &self,
        py: Python<'_>,
        boxes: &StateBoxes,
        costs: PyReadonlyArray2<'_, f64>,
        budget_kw: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<StepCuts> {
        let boxes = boxes.at_starts(self.inner.n_strings(), self.inner.n_steps())?;
        let costs = self.loss_costs(&costs)?;
        let budget_w = flat(budget_kw.as_array(), W_PER_KW);
        let answer = py.detach(|| self.inner.step_bounds(&boxes, &costs, &budget_w)).map_err(refused)?;
        Ok(StepCuts {
            phi: vector(py, answer.bounds.iter().map(|b| b.phi).collect()),
            shed_slope: vector(py, answer.bounds.iter().map(|b| b.shed_slope * W_PER_KW).collect()),
            request_kw: self.signed_kw(py, &answer.request_w),
        })
    }

    /// Bounds the cost of every schedule, given costs of the losses `(M, 4)` [1/kW], and the states of those that cost no
    /// more than `request_kw` `(M, T)` and shed at most `shed_budget_kw` in all.
    fn confine(
        &self,
        py: Python<'_>,
        request_kw: PyReadonlyArray2<'_, f64>,
        costs: PyReadonlyArray2<'_, f64>,
        shed_budget_kw: f64,
    ) -> PyResult<Confined> {
        check_shape("request", &[self.inner.n_strings(), self.inner.n_steps()], request_kw.shape())?;
        let request_w = self.inner.magnitudes(&flat(request_kw.as_array(), W_PER_KW)).map_err(refused)?;
        let costs = self.loss_costs(&costs)?;
        let answer = py
            .detach(|| self.inner.confine(&request_w, &costs, shed_budget_kw * W_PER_KW))
            .map_err(refused)?;
        Ok(Confined {
            bound: answer.bound,
            boxes: Py::new(py, self.boxes(answer.boxes))?,
            may_shed: flags(py, self.inner.n_strings(), answer.may_shed),
        })
    }

    /// Coefficients over boxes of states; planes are closest at the states `near`, boxes that are points.
    fn coefficients(
        &self,
        py: Python<'_>,
        boxes: &StateBoxes,
        near: &StateBoxes,
    ) -> PyResult<CoefficientBounds> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let boxes = boxes.at_starts(n_strings, n_steps)?;
        let state = |b: &StateBox| StringState { soc: b.soc.low, temperature_c: b.temperature_c.low };
        let near: Vec<_> = near.at_starts(n_strings, n_steps)?.iter().map(state).collect();
        let (ranges, planes) = (self.inner.ranges(&boxes), self.inner.planes(&boxes, &near));
        let range =
            |of: &dyn Fn(&CoefficientRanges) -> f64| matrix(py, n_strings, ranges.iter().map(of).collect());
        let plane = |of: &dyn Fn(&Planes) -> f64| matrix(py, n_strings, planes.iter().map(of).collect());
        Ok(CoefficientBounds {
            derating_low: range(&|r| r.derating.low),
            derating_high: range(&|r| r.derating.high),
            voltage_low_v: range(&|r| r.voltage_v.low),
            voltage_high_v: range(&|r| r.voltage_v.high),
            resistance_low_ohm: range(&|r| r.resistance_ohm.low),
            resistance_high_ohm: range(&|r| r.resistance_ohm.high),
            power_scale_low_kw: range(&|r| r.power_scale_w.low / W_PER_KW),
            power_scale_high_kw: range(&|r| r.power_scale_w.high / W_PER_KW),
            plane_kw: plane(&|p| p.power_scale_w / W_PER_KW),
            plane_per_soc_kw: plane(&|p| p.power_scale_per_soc / W_PER_KW),
            plane_per_k_kw: plane(&|p| p.power_scale_per_k / W_PER_KW),
            derated: plane(&|p| p.derated),
            derated_per_k: plane(&|p| p.derated_per_k),
        })
    }
}
