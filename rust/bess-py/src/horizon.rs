//! One split problem: search, bounds, and what the relaxation needs to know.

use std::time::{Duration, Instant};

use bess_control::{Effort, Losses, SplitProblem, StateBox, StringState};
use bess_tables::units::W_PER_KW;
use numpy::ndarray::Dimension;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::answers::{signed_kw, CoefficientRanges, Confined, Incumbent, SplitAnswer, StepBounds};
use crate::arrays::{
    check_shape, matrix, numbers, refused, scaled, watts, Given, GivenCube, GivenMatrix, GivenVector, Matrix,
};
use crate::model::ControlModel;
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
        soc0: GivenVector<'_>,
        temperature0_c: GivenVector<'_>,
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
            soc: &numbers(&soc0),
            temperature_c: &numbers(&temperature0_c),
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

    /// Searches for the best schedule, from requests `(M, T)` [kW, of any sign] if given, and bounds what it found.
    /// `rollouts` is the effort of one descent; after `time_limit_s` the best known is returned.
    #[pyo3(signature = (warm_start_kw, rollouts, time_limit_s=None))]
    fn split(
        &self,
        py: Python<'_>,
        warm_start_kw: Option<GivenMatrix<'_>>,
        rollouts: usize,
        time_limit_s: Option<f64>,
    ) -> PyResult<SplitAnswer> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let warm_start_w = match &warm_start_kw {
            None => None,
            Some(array) => {
                check_shape("warm_start", &[n_strings, n_steps], array.shape())?;
                let given = watts(array);
                // What points against the demand of its step says nothing about it.
                Some(self.inner.signed(&given).into_iter().map(|p| p.max(0.0)).collect::<Vec<_>>())
            }
        };
        let deadline = time_limit_s
            .and_then(|s| Instant::now().checked_add(Duration::try_from_secs_f64(s.max(0.0)).ok()?));
        let effort = Effort { rollouts, deadline };
        let answer = py.detach(|| self.inner.split(warm_start_w.as_deref(), &effort));
        SplitAnswer::new(py, &self.inner, answer)
    }

    /// The best of requests in the proportions of `wanted_kw` `(B, M, T)`, `>= 0`, that meet the demand; None where the
    /// incumbent is as good.
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

    /// Each step's optimum at the state reached, `(M, T)` [kW, signed].
    fn greedy(&self, py: Python<'_>) -> Matrix {
        let best = py.detach(|| self.inner.greedy());
        signed_kw(py, &self.inner, &best.request_w)
    }

    /// All reachable states `(M, T + 1)`.
    fn reachable(&self, py: Python<'_>) -> StateBoxes {
        StateBoxes { n_strings: self.inner.n_strings(), boxes: py.detach(|| self.inner.reachable()) }
    }

    /// Step cuts of one objective over boxes of states, with costs of the losses `(M, 4)` [1/kW]; the best if at most
    /// `budget_kw` `(T,)` is shed in a step.
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

    /// Bounds the cost of every schedule, given costs of the losses `(M, 4)` [1/kW], and the states of those that cost no
    /// more than `request_kw` `(M, T)` and shed at most `shed_budget_kw` in all.
    fn confine(
        &self,
        py: Python<'_>,
        request_kw: GivenMatrix<'_>,
        costs: GivenMatrix<'_>,
        shed_budget_kw: f64,
    ) -> PyResult<Confined> {
        let request_w = self.magnitudes(&request_kw)?;
        let costs = self.loss_costs(&costs)?;
        let answer = py
            .detach(|| self.inner.confine(&request_w, &costs, shed_budget_kw * W_PER_KW))
            .map_err(refused)?;
        Confined::new(py, self.inner.n_strings(), answer)
    }

    /// Coefficients over boxes of states; planes are closest at the states `near`, boxes that are points.
    fn coefficients(
        &self,
        py: Python<'_>,
        boxes: &StateBoxes,
        near: &StateBoxes,
    ) -> PyResult<CoefficientRanges> {
        let (n_strings, n_steps) = (self.inner.n_strings(), self.inner.n_steps());
        let boxes = boxes.at_starts(n_strings, n_steps)?;
        let state = |b: &StateBox| StringState { soc: b.soc.low, temperature_c: b.temperature_c.low };
        let near: Vec<_> = near.at_starts(n_strings, n_steps)?.iter().map(state).collect();
        let (ranges, planes) = (self.inner.ranges(&boxes), self.inner.planes(&boxes, &near));
        Ok(CoefficientRanges::new(py, n_strings, &ranges, &planes))
    }
}
