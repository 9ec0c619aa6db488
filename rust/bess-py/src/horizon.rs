//! One split problem: search, bounds, and data of the relaxation.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bess_control::{Effort, LossUnits, Losses, SplitProblem};
use bess_tables::units::W_PER_KW;
use numpy::ndarray::Dimension;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::answers::{signed_kw, Incumbent, SplitAnswer, StepBounds, TightenedBounds};
use crate::arrays::{
    check_shape, matrix, numbers, refused, scaled, watts, Given, GivenCube, GivenMatrix, GivenVector, Matrix,
};
use crate::flows::FlowArrays;
use crate::model::ControlModel;
use crate::nodes::Node;
use crate::states::StateBoxes;

/// One split problem on the control model. Requests are signed as the demand is; limits are magnitudes.
#[pyclass(frozen, module = "bess._core")]
pub struct ControlHorizon {
    inner: bess_control::ControlHorizon,
}

impl ControlHorizon {
    /// Requests `(..., M, T)` [kW] as checked magnitudes [W].
    fn magnitudes<D: Dimension>(&self, request_kw: &Given<'_, D>) -> PyResult<Vec<f64>> {
        let shape = request_kw.shape();
        let batch = &shape[..shape.len() - 2];
        let needed = [batch, &[self.inner.n_strings(), self.inner.n_steps()]].concat();
        check_shape("request", &needed, shape)?;
        self.inner.magnitudes(&watts(request_kw)).map_err(refused)
    }

    /// Costs of the losses of each string [1/W] from an array `(M, 4)` [1/kW].
    fn loss_costs(&self, costs: &GivenMatrix<'_>) -> PyResult<Vec<Losses>> {
        check_shape("costs", &[self.inner.n_strings(), 4], costs.shape())?;
        Ok(Losses::rows(&scaled(costs, 1.0 / W_PER_KW)))
    }
}

#[pymethods]
impl ControlHorizon {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        model: &ControlModel,
        soc: GivenVector<'_>,
        temperature_c: GivenVector<'_>,
        demand_kw: GivenVector<'_>,
        ambient_c: GivenVector<'_>,
        dt_h: f64,
        limit_kw: GivenMatrix<'_>,
        costs: GivenCube<'_>,
        search_costs: GivenCube<'_>,
        tol_abs: GivenVector<'_>,
        tol_rel: GivenVector<'_>,
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
        Ok(Self { inner: bess_control::ControlHorizon::new(model.inner.clone(), &problem).map_err(refused)? })
    }

    /// Searches for the best schedule, from requests `(M, T)` [kW, of any sign] if given, and bounds the result.
    /// `rollouts` is the effort of one descent; after `time_limit_s` the best known is returned. A schedule
    /// within the relative `gap` of its bounds needs no distant starts.
    #[pyo3(signature = (warm_start_kw, rollouts, time_limit_s=None, gap=0.0))]
    fn split(
        &self,
        py: Python<'_>,
        warm_start_kw: Option<GivenMatrix<'_>>,
        rollouts: usize,
        time_limit_s: Option<f64>,
        gap: f64,
    ) -> PyResult<SplitAnswer> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let warm_start_w = match &warm_start_kw {
            None => None,
            Some(array) => {
                check_shape("warm_start", &[n_strings, n_steps], array.shape())?;
                let given = watts(array);
                // Requests opposite to the demand of their step carry no information.
                Some(self.inner.signed(&given).into_iter().map(|p| p.max(0.0)).collect::<Vec<_>>())
            }
        };
        let deadline = time_limit_s
            .and_then(|s| Instant::now().checked_add(Duration::try_from_secs_f64(s.max(0.0)).ok()?));
        let effort = Effort { rollouts, deadline, gap };
        let answer = py.detach(|| self.inner.split(warm_start_w.as_deref(), &effort));
        SplitAnswer::new(py, &self.inner, answer)
    }

    /// Best of the requests in the proportions of `wanted_kw` `(B, M, T)`, `>= 0`, that meet the demand; None
    /// if the incumbent is as good.
    fn best_of(
        &self,
        py: Python<'_>,
        incumbent: &Incumbent,
        wanted_kw: GivenCube<'_>,
    ) -> PyResult<Option<Incumbent>> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let shape = wanted_kw.shape();
        check_shape("wanted", &[shape[0], n_strings, n_steps], shape)?;
        let wanted = numbers(&wanted_kw);
        if wanted.iter().any(|w| !(*w >= 0.0 && w.is_finite())) {
            return Err(PyValueError::new_err("wanted: every value must be finite and >= 0"));
        }
        let (mut best, mut is_better) = (incumbent.inner.clone(), false);
        for wanted in wanted.chunks_exact((n_strings * n_steps).max(1)) {
            is_better |= best.offer(&self.inner, self.inner.rated(self.inner.fitted(wanted)));
        }
        Ok(is_better.then(|| Incumbent::new(py, &self.inner, best)))
    }

    /// Group objectives in the costs of the search `(B, G)` of requests `(B, M, T)` [kW].
    fn evaluate(&self, py: Python<'_>, request_kw: GivenCube<'_>) -> PyResult<Matrix> {
        let requests_w = self.magnitudes(&request_kw)?;
        let values = py.detach(|| self.inner.evaluate(&requests_w));
        Ok(matrix(py, request_kw.shape()[0], values))
    }

    /// Optimum of each step at the state reached, `(M, T)` [kW, signed].
    fn greedy(&self, py: Python<'_>) -> Matrix {
        let best = py.detach(|| self.inner.greedy());
        signed_kw(py, &self.inner, &best.request_w)
    }

    /// All reachable states `(M, T + 1)`.
    fn reachable(&self, py: Python<'_>) -> StateBoxes {
        StateBoxes { n_strings: self.inner.n_strings(), boxes: py.detach(|| self.inner.reachable()) }
    }

    /// Step cuts of one objective over boxes of states, with costs of the losses `(M, 4)` [1/kW]; tightest if
    /// at most `budget_kw` `(T,)` is shed in a step.
    fn step_bounds(
        &self,
        py: Python<'_>,
        boxes: &StateBoxes,
        costs: GivenMatrix<'_>,
        budget_kw: GivenVector<'_>,
    ) -> PyResult<StepBounds> {
        let boxes = boxes.at_starts(self.inner.n_strings(), self.inner.n_steps())?;
        let costs = self.loss_costs(&costs)?;
        let budget_w = watts(&budget_kw);
        let answer = py.detach(|| self.inner.step_bounds(&boxes, &costs, &budget_w)).map_err(refused)?;
        Ok(StepBounds::new(py, &self.inner, &answer))
    }

    /// Bounds the cost of every schedule for costs of the losses `(M, 4)` [1/kW]; also the states of
    /// schedules that cost at most as much as `request_kw` `(M, T)` and shed at most `shed_budget_kw` in
    /// total.
    fn tighten(
        &self,
        py: Python<'_>,
        request_kw: GivenMatrix<'_>,
        costs: GivenMatrix<'_>,
        shed_budget_kw: f64,
    ) -> PyResult<TightenedBounds> {
        let request_w = self.magnitudes(&request_kw)?;
        let costs = self.loss_costs(&costs)?;
        let answer = py
            .detach(|| self.inner.tighten(&request_w, &costs, shed_budget_kw * W_PER_KW))
            .map_err(refused)?;
        TightenedBounds::new(py, self.inner.n_strings(), answer)
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
        ceilings: GivenVector<'_>,
        objective: f64,
        sample: usize,
    ) -> PyResult<f64> {
        if ceilings.len() >= self.inner.n_groups() {
            return Err(PyValueError::new_err("ceilings: give those of earlier groups only"));
        }
        let ceilings = numbers(&ceilings);
        Ok(py.detach(|| self.inner.priced_bound(&ceilings, objective, sample)))
    }

    /// Node of all schedules with states in these boxes `(M, T + 1)`.
    fn root(&self, boxes: &StateBoxes) -> PyResult<Node> {
        let n_strings = self.inner.n_strings();
        let needed = [n_strings, self.inner.n_steps() + 1];
        check_shape("boxes", &needed, &[boxes.n_strings, boxes.boxes.len() / boxes.n_strings.max(1)])?;
        Ok(Node { n_strings, inner: self.inner.root(boxes.boxes.clone()), narrowed: None })
    }

    /// Tightens a node: removes schedules that cannot meet the demand with at most `shed_budget_kw` shed in
    /// total. None if the node is empty.
    fn narrowed(&self, py: Python<'_>, node: &Node, shed_budget_kw: f64) -> Option<Node> {
        let narrowed = py.detach(|| self.inner.narrowed(&node.inner, shed_budget_kw * W_PER_KW));
        narrowed.map(|narrowed| Node::of(self.inner.n_strings(), narrowed))
    }

    /// Step cuts like [`Self::step_bounds`] over a narrowed node.
    fn step_bounds_of(
        &self,
        py: Python<'_>,
        node: &Node,
        costs: GivenMatrix<'_>,
        budget_kw: GivenVector<'_>,
    ) -> PyResult<StepBounds> {
        let narrowed = node.narrowed.as_ref().ok_or_else(|| PyValueError::new_err("node: not narrowed"))?;
        let (costs, budget_w) = (self.loss_costs(&costs)?, watts(&budget_kw));
        let answer = py.detach(|| self.inner.step_bounds_of(narrowed, &costs, &budget_w)).map_err(refused)?;
        Ok(StepBounds::new(py, &self.inner, &answer))
    }

    /// Coefficients of the relaxation over a narrowed node by name, each `(M, T)`. Planes are tightest at the states
    /// `near`, which are points; if `frozen`, the coefficients of battery and derating are those of these states.
    /// `units_kw` `(M, 2)` are the nominal losses of inverter and battery.
    fn relaxed(
        &self,
        py: Python<'_>,
        node: &Node,
        near: &StateBoxes,
        frozen: bool,
        units_kw: GivenMatrix<'_>,
    ) -> PyResult<BTreeMap<&'static str, Matrix>> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let narrowed = node.narrowed.as_ref().ok_or_else(|| PyValueError::new_err("node: not narrowed"))?;
        check_shape("units", &[n_strings, 2], units_kw.shape())?;
        let units: Vec<_> = watts(&units_kw)
            .chunks_exact(2)
            .map(|u| LossUnits { inverter_w: u[0], battery_w: u[1] })
            .collect();
        let near = near.points(n_strings, n_steps)?;
        let values = py.detach(|| self.inner.relaxed(narrowed, &near, frozen, &units));
        Ok(values.into_iter().map(|(name, row)| (name, matrix(py, n_strings, row))).collect())
    }

    /// Flows of single steps, from states `(M, T)`, which are points, with requests `(M, T)` [kW],
    /// magnitudes.
    fn flows_from(
        &self,
        py: Python<'_>,
        states: &StateBoxes,
        request_kw: GivenMatrix<'_>,
    ) -> PyResult<FlowArrays> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        check_shape("request", &[n_strings, n_steps], request_kw.shape())?;
        let states = states.points(n_strings, n_steps)?;
        let flows = self.inner.flows_from(&states, &watts(&request_kw));
        let directions: Vec<_> = (0..n_steps).map(|t| self.inner.direction(t)).collect();
        Ok(FlowArrays::new(py, &[n_strings, n_steps], &flows, &directions))
    }
}
