//! One split problem: search, bounds, and data of the relaxation.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bess_control::{Effort, Flow, LossUnits, Losses, Node as Part, SplitProblem, StateBox, StringState};
use bess_tables::units::W_PER_KW;
use numpy::ndarray::Dimension;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{
    check_shape, kilowatts, matrix, numbers, scaled, value_error, vector, watts, ArrayIn, CubeIn, Flags,
    Matrix, MatrixIn, Vector, VectorIn,
};
use crate::model::{ControlModel, FlowArrays};
use crate::node::{Node, StateBoxes};

/// The best schedule of a search so far.
#[pyclass(frozen, module = "bess._core")]
pub struct Incumbent {
    inner: bess_control::Incumbent,
    /// Requests `(M, T)` [kW, signed].
    #[pyo3(get)]
    request_kw: Matrix,
    /// Objectives of the groups in the costs of the search `(G,)`.
    #[pyo3(get)]
    objectives: Vector,
}

/// Objective and bounds of one group.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct GroupBounds {
    /// Objective in reported costs.
    objective: f64,
    /// Ceiling of this objective while later groups are minimised.
    ceiling: f64,
    /// Lower bound of the nonlinear control model.
    bound: f64,
    /// Objective in search costs.
    search_objective: f64,
    search_ceiling: f64,
    /// Lower bound of the convexified program, with coefficients frozen along the schedule.
    search_bound: f64,
    /// Whether `search_bound` is the optimum of the convexified program.
    is_search_optimum: bool,
    /// Boxes of the states of all schedules that are no worse `(M, T + 1)`; None if the bound needs none.
    boxes: Option<Py<StateBoxes>>,
}

/// The best schedule found, its flows, and the bounds of each group.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct SplitAnswer {
    incumbent: Py<Incumbent>,
    flows: Py<FlowArrays>,
    groups: Vec<Py<GroupBounds>>,
    rollouts: usize,
}

/// Step cuts `cost + shed_slope shed >= phi`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct StepBounds {
    /// `(T,)`
    phi: Vector,
    /// Maximum saving per availability loss `(T,)` [1/kW].
    shed_slope: Vector,
    /// Best requests of each step if nothing is shed `(M, T)` [kW, signed].
    request_kw: Matrix,
}

/// One split problem on the control model. Requests are signed as the demand is; limits are magnitudes.
#[pyclass(frozen, module = "bess._core")]
pub struct ControlHorizon {
    inner: bess_control::ControlHorizon,
}

impl ControlHorizon {
    /// Number of strings and steps.
    fn shape(&self) -> [usize; 2] {
        [self.inner.n_strings(), self.inner.n_steps()]
    }

    /// A node of this horizon that is tightened.
    fn tightened_part<'a>(&self, node: &'a Node) -> PyResult<&'a Part> {
        node.check_shape(&self.shape())?;
        node.tightened()
    }

    /// Requests `(..., M, T)` [kW] as checked magnitudes [W].
    fn magnitudes<D: Dimension>(&self, request_kw: &ArrayIn<'_, D>) -> PyResult<Vec<f64>> {
        let shape = request_kw.shape();
        let needed = [&shape[..shape.len() - 2], &self.shape()].concat();
        check_shape("request", &needed, shape)?;
        self.inner.magnitudes(&watts(request_kw)).map_err(value_error)
    }

    /// Magnitudes `(M, T)` [W] as signed requests [kW].
    fn signed_kw(&self, py: Python<'_>, request_w: &[f64]) -> Matrix {
        matrix(py, self.inner.n_strings(), kilowatts(self.inner.signed(request_w)))
    }

    /// Costs of the losses of each string [1/W] from an array `(M, 4)` [1/kW].
    fn loss_costs(&self, costs: &MatrixIn<'_>) -> PyResult<Vec<Losses>> {
        check_shape("costs", &[self.inner.n_strings(), 4], costs.shape())?;
        Ok(Losses::rows(&scaled(costs, 1.0 / W_PER_KW)))
    }

    /// Boxes at the starts of the steps.
    fn at_starts(&self, states: &StateBoxes) -> PyResult<Vec<StateBox>> {
        let ([n_strings, n_steps], given) = (self.shape(), states.n_states());
        let needed = if given == n_steps + 1 { given } else { n_steps };
        check_shape("states", &[n_strings, needed], &[states.n_strings, given])?;
        Ok(states.boxes.chunks_exact(given.max(1)).flat_map(|row| row[..n_steps].to_vec()).collect())
    }

    /// States at the starts of the steps, of boxes that are points.
    fn points(&self, states: &StateBoxes) -> PyResult<Vec<StringState>> {
        let state = |b: &StateBox| StringState { soc: b.soc.low, temperature_c: b.temperature_c.low };
        Ok(self.at_starts(states)?.iter().map(state).collect())
    }

    fn boxes(&self, boxes: Vec<StateBox>) -> StateBoxes {
        StateBoxes { n_strings: self.inner.n_strings(), boxes }
    }

    fn flows(&self, py: Python<'_>, flows: &[Flow]) -> FlowArrays {
        let directions: Vec<_> = (0..self.inner.n_steps()).map(|t| self.inner.direction(t)).collect();
        FlowArrays::new(py, &self.shape(), flows, &directions)
    }

    fn incumbent(&self, py: Python<'_>, inner: bess_control::Incumbent) -> Incumbent {
        let request_kw = self.signed_kw(py, &inner.schedule.request_w);
        let objectives = vector(py, inner.schedule.objectives[..self.inner.n_groups()].to_vec());
        Incumbent { request_kw, objectives, inner }
    }

    fn group(&self, py: Python<'_>, of: bess_control::GroupBounds) -> PyResult<Py<GroupBounds>> {
        let boxes = (!of.boxes.is_empty()).then(|| Py::new(py, self.boxes(of.boxes))).transpose()?;
        let group = GroupBounds {
            objective: of.objective,
            ceiling: of.ceiling,
            bound: of.bound,
            search_objective: of.search_objective,
            search_ceiling: of.search_ceiling,
            search_bound: of.search_bound,
            is_search_optimum: of.is_search_optimum,
            boxes,
        };
        Py::new(py, group)
    }

    fn cuts(&self, py: Python<'_>, of: &bess_control::StepBounds) -> StepBounds {
        StepBounds {
            phi: vector(py, of.bounds.iter().map(|b| b.phi).collect()),
            shed_slope: vector(py, of.bounds.iter().map(|b| b.shed_slope * W_PER_KW).collect()),
            request_kw: self.signed_kw(py, &of.request_w),
        }
    }
}

#[pymethods]
impl ControlHorizon {
    #[new]
    fn new(
        model: &ControlModel,
        soc: VectorIn<'_>,
        temperature_c: VectorIn<'_>,
        demand_kw: VectorIn<'_>,
        ambient_c: VectorIn<'_>,
        dt_h: f64,
        limit_kw: MatrixIn<'_>,
        costs: CubeIn<'_>,
        search_costs: CubeIn<'_>,
        tol_abs: VectorIn<'_>,
        tol_rel: VectorIn<'_>,
    ) -> PyResult<Self> {
        let n_strings = model.inner.strings().len();
        check_shape("limit", &[n_strings, demand_kw.len()], limit_kw.shape())?;
        for costs in [&costs, &search_costs] {
            check_shape("costs", &[tol_abs.len(), n_strings, 4], costs.shape())?;
        }
        let problem = SplitProblem {
            soc: &numbers(&soc),
            temperature_c: &numbers(&temperature_c),
            demand_w: &watts(&demand_kw),
            ambient_c: &numbers(&ambient_c),
            dt_h,
            limit_w: &watts(&limit_kw),
            costs: &scaled(&costs, 1.0 / W_PER_KW),
            search_costs: &scaled(&search_costs, 1.0 / W_PER_KW),
            tolerance_abs: &numbers(&tol_abs),
            tolerance_rel: &numbers(&tol_rel),
        };
        Ok(Self {
            inner: bess_control::ControlHorizon::new(model.inner.clone(), &problem).map_err(value_error)?,
        })
    }

    /// Searches for the best schedule, from requests `(M, T)` [kW, of any sign] if given, and bounds the result.
    /// `rollouts` is the effort of one descent; after `time_limit_s` the best known is returned. A schedule
    /// within the relative `gap` of its bounds needs no distant starts.
    #[pyo3(signature = (warm_start_kw, rollouts, time_limit_s=None, gap=0.0))]
    fn split(
        &self,
        py: Python<'_>,
        warm_start_kw: Option<MatrixIn<'_>>,
        rollouts: usize,
        time_limit_s: Option<f64>,
        gap: f64,
    ) -> PyResult<SplitAnswer> {
        // Requests opposite to the demand of their step carry no information.
        let of_demand = |array: &MatrixIn<'_>| -> PyResult<Vec<f64>> {
            check_shape("warm_start", &self.shape(), array.shape())?;
            Ok(self.inner.signed(&watts(array)).into_iter().map(|p| p.max(0.0)).collect())
        };
        let warm_start_w = warm_start_kw.as_ref().map(of_demand).transpose()?;
        let deadline = time_limit_s
            .and_then(|s| Instant::now().checked_add(Duration::try_from_secs_f64(s.max(0.0)).ok()?));
        let effort = Effort { rollouts, deadline, gap };
        let answer = py.detach(|| self.inner.split(warm_start_w.as_deref(), &effort));
        Ok(SplitAnswer {
            incumbent: Py::new(py, self.incumbent(py, answer.incumbent))?,
            flows: Py::new(py, self.flows(py, &answer.flows))?,
            groups: answer.groups.into_iter().map(|of| self.group(py, of)).collect::<PyResult<_>>()?,
            rollouts: answer.rollouts,
        })
    }

    /// Best of the requests in the proportions of `wanted_kw` `(B, M, T)`, `>= 0`, that meet the demand; None
    /// if the incumbent is as good.
    fn best_of(
        &self,
        py: Python<'_>,
        incumbent: &Incumbent,
        wanted_kw: CubeIn<'_>,
    ) -> PyResult<Option<Incumbent>> {
        let ([n_strings, n_steps], shape) = (self.shape(), wanted_kw.shape());
        check_shape("wanted", &[shape[0], n_strings, n_steps], shape)?;
        let wanted = numbers(&wanted_kw);
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
    fn evaluate(&self, py: Python<'_>, request_kw: CubeIn<'_>) -> PyResult<Matrix> {
        let requests_w = self.magnitudes(&request_kw)?;
        let values = py.detach(|| self.inner.evaluate(&requests_w));
        Ok(matrix(py, request_kw.shape()[0], values))
    }

    /// Optimum of each step at the state reached, `(M, T)` [kW, signed].
    fn greedy(&self, py: Python<'_>) -> Matrix {
        let best = py.detach(|| self.inner.greedy());
        self.signed_kw(py, &best.request_w)
    }

    /// All reachable states `(M, T + 1)`.
    fn reachable(&self, py: Python<'_>) -> StateBoxes {
        self.boxes(py.detach(|| self.inner.reachable()))
    }

    /// Step cuts of one objective over boxes of states, with costs of the losses `(M, 4)` [1/kW]; tightest if
    /// at most `budget_kw` `(T,)` is shed in a step.
    fn step_bounds(
        &self,
        py: Python<'_>,
        boxes: &StateBoxes,
        costs: MatrixIn<'_>,
        budget_kw: VectorIn<'_>,
    ) -> PyResult<StepBounds> {
        let boxes = self.at_starts(boxes)?;
        let (costs, budget_w) = (self.loss_costs(&costs)?, watts(&budget_kw));
        let answer = py.detach(|| self.inner.step_bounds(&boxes, &costs, &budget_w)).map_err(value_error)?;
        Ok(self.cuts(py, &answer))
    }

    /// Bounds the cost of every schedule for costs of the losses `(M, 4)` [1/kW]; also the states `(M, T + 1)` of
    /// schedules that cost at most as much as `request_kw` `(M, T)` and shed at most `shed_budget_kw` in
    /// total, and whether a string may shed in a step `(M, T)`.
    fn tighten(
        &self,
        py: Python<'_>,
        request_kw: MatrixIn<'_>,
        costs: MatrixIn<'_>,
        shed_budget_kw: f64,
    ) -> PyResult<(f64, StateBoxes, Flags)> {
        let (request_w, costs) = (self.magnitudes(&request_kw)?, self.loss_costs(&costs)?);
        let answer = py
            .detach(|| self.inner.tighten(&request_w, &costs, shed_budget_kw * W_PER_KW))
            .map_err(value_error)?;
        let may_shed = matrix(py, self.inner.n_strings(), self.inner.may_shed(&answer.boxes));
        Ok((answer.bound, self.boxes(answer.boxes), may_shed))
    }

    /// Number of kinds of strings: strings of one kind are equal except for their states.
    fn n_kinds(&self) -> usize {
        self.inner.n_kinds()
    }

    /// Lower bound of the objective of the group after those with `ceilings`, from shadow prices of the balance, which ascend
    /// on at most `sample` strings; at most the `objective` of a known schedule.
    fn priced_bound(
        &self,
        py: Python<'_>,
        ceilings: VectorIn<'_>,
        objective: f64,
        sample: usize,
    ) -> PyResult<f64> {
        if ceilings.len() >= self.inner.n_groups() {
            return Err(PyValueError::new_err("ceilings: give those of earlier groups only"));
        }
        let ceilings = numbers(&ceilings);
        if ceilings.iter().chain([&objective]).any(|value| value.is_nan() || *value < 0.0) {
            return Err(PyValueError::new_err("ceilings and objective: must be >= 0"));
        }
        Ok(py.detach(|| self.inner.priced_bound(&ceilings, objective, sample)))
    }

    /// Node of all schedules with states in these boxes `(M, T + 1)`.
    fn root(&self, boxes: &StateBoxes) -> PyResult<Node> {
        let [n_strings, n_steps] = self.shape();
        check_shape("boxes", &[n_strings, n_steps + 1], &[boxes.n_strings, boxes.n_states()])?;
        Ok(Node { n_strings, inner: self.inner.root(boxes.boxes.clone()) })
    }

    /// Tightens a node: removes schedules that cannot meet the demand with at most `shed_budget_kw` shed in
    /// total. None if the node is empty.
    fn tighten_node(&self, py: Python<'_>, node: &Node, shed_budget_kw: f64) -> PyResult<Option<Node>> {
        node.check_shape(&self.shape())?;
        if shed_budget_kw.is_nan() {
            return Err(PyValueError::new_err("shed_budget_kw: is not a number"));
        }
        let inner = py.detach(|| self.inner.tighten_node(&node.inner, shed_budget_kw * W_PER_KW));
        Ok(inner.map(|inner| Node { n_strings: self.inner.n_strings(), inner }))
    }

    /// Step cuts like [`Self::step_bounds`] over a tightened node.
    fn step_bounds_of(
        &self,
        py: Python<'_>,
        node: &Node,
        costs: MatrixIn<'_>,
        budget_kw: VectorIn<'_>,
    ) -> PyResult<StepBounds> {
        let node = self.tightened_part(node)?;
        let (costs, budget_w) = (self.loss_costs(&costs)?, watts(&budget_kw));
        let answer = py.detach(|| self.inner.step_bounds_of(node, &costs, &budget_w)).map_err(value_error)?;
        Ok(self.cuts(py, &answer))
    }

    /// Coefficients of the relaxation over a tightened node by name, each `(M, T)`. Planes are tightest at the states
    /// `near`, which are points; if `frozen`, the coefficients of battery and derating are those of these states.
    /// `units_kw` `(M, 2)` are the nominal losses of inverter and battery.
    fn relaxed(
        &self,
        py: Python<'_>,
        node: &Node,
        near: &StateBoxes,
        frozen: bool,
        units_kw: MatrixIn<'_>,
    ) -> PyResult<BTreeMap<&'static str, Matrix>> {
        let (n_strings, node) = (self.inner.n_strings(), self.tightened_part(node)?);
        check_shape("units", &[n_strings, 2], units_kw.shape())?;
        let units: Vec<_> = watts(&units_kw)
            .chunks_exact(2)
            .map(|u| LossUnits { inverter_w: u[0], battery_w: u[1] })
            .collect();
        let near = self.points(near)?;
        let values = py.detach(|| self.inner.relaxed(node, &near, frozen, &units));
        Ok(values.into_iter().map(|(name, row)| (name, matrix(py, n_strings, row))).collect())
    }

    /// Flows of single steps, from states `(M, T)`, which are points, with requests `(M, T)` [kW], magnitudes.
    fn flows_from(
        &self,
        py: Python<'_>,
        states: &StateBoxes,
        request_kw: MatrixIn<'_>,
    ) -> PyResult<FlowArrays> {
        check_shape("request", &self.shape(), request_kw.shape())?;
        let states = self.points(states)?;
        Ok(self.flows(py, &self.inner.flows_from(&states, &watts(&request_kw))))
    }
}
