//! Results of a split problem, as arrays in kW.

use bess_control::{ControlHorizon, Split};
use bess_tables::units::W_PER_KW;
use pyo3::prelude::*;

use crate::arrays::{flags, kilowatts, matrix, vector, Flags, Matrix, Vector};
use crate::flows::FlowArrays;
use crate::states::StateBoxes;

/// The best schedule of a search so far.
#[pyclass(frozen, module = "bess._core")]
pub struct Incumbent {
    pub(crate) inner: bess_control::Incumbent,
    /// Requests `(M, T)` [kW, signed].
    #[pyo3(get)]
    request_kw: Matrix,
    /// Objectives of the groups in the costs of the search `(G,)`.
    #[pyo3(get)]
    objectives: Vector,
}

impl Incumbent {
    pub(crate) fn new(py: Python<'_>, horizon: &ControlHorizon, inner: bess_control::Incumbent) -> Self {
        Self {
            request_kw: signed_kw(py, horizon, &inner.schedule.request_w),
            objectives: vector(py, inner.schedule.objectives[..horizon.n_groups()].to_vec()),
            inner,
        }
    }
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

impl GroupBounds {
    fn new(py: Python<'_>, n_strings: usize, of: bess_control::GroupBounds) -> PyResult<Self> {
        let boxes = if of.boxes.is_empty() {
            None
        } else {
            Some(Py::new(py, StateBoxes { n_strings, boxes: of.boxes })?)
        };
        Ok(Self {
            objective: of.objective,
            ceiling: of.ceiling,
            bound: of.bound,
            search_objective: of.search_objective,
            search_ceiling: of.search_ceiling,
            search_bound: of.search_bound,
            is_search_optimum: of.is_search_optimum,
            boxes,
        })
    }
}

/// The best schedule found, its flows, and the bounds of each group.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct SplitAnswer {
    incumbent: Py<Incumbent>,
    flows: Py<FlowArrays>,
    groups: Vec<Py<GroupBounds>>,
    rollouts: usize,
}

impl SplitAnswer {
    pub(crate) fn new(py: Python<'_>, horizon: &ControlHorizon, of: Split) -> PyResult<Self> {
        let (n_strings, n_steps) = (horizon.n_strings(), horizon.n_steps());
        let directions: Vec<_> = (0..n_steps).map(|t| horizon.direction(t)).collect();
        let group = |of| Py::new(py, GroupBounds::new(py, n_strings, of)?);
        Ok(Self {
            incumbent: Py::new(py, Incumbent::new(py, horizon, of.incumbent))?,
            flows: Py::new(py, FlowArrays::new(py, &[n_strings, n_steps], &of.flows, &directions))?,
            groups: of.groups.into_iter().map(group).collect::<PyResult<_>>()?,
            rollouts: of.rollouts,
        })
    }
}

/// Bound of a group, and boxes of the states of all schedules that are no worse than a given one.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct TightenedBounds {
    bound: f64,
    boxes: Py<StateBoxes>,
    may_shed: Flags,
}

impl TightenedBounds {
    pub(crate) fn new(py: Python<'_>, n_strings: usize, of: bess_control::TightenedBounds) -> PyResult<Self> {
        Ok(Self {
            bound: of.bound,
            boxes: Py::new(py, StateBoxes { n_strings, boxes: of.boxes })?,
            may_shed: flags(py, n_strings, of.may_shed),
        })
    }
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

impl StepBounds {
    pub(crate) fn new(py: Python<'_>, horizon: &ControlHorizon, of: &bess_control::StepBounds) -> Self {
        Self {
            phi: vector(py, of.bounds.iter().map(|b| b.phi).collect()),
            shed_slope: vector(py, of.bounds.iter().map(|b| b.shed_slope * W_PER_KW).collect()),
            request_kw: signed_kw(py, horizon, &of.request_w),
        }
    }
}

/// Magnitudes `(M, T)` [W] as signed requests [kW].
pub(crate) fn signed_kw(py: Python<'_>, horizon: &ControlHorizon, request_w: &[f64]) -> Matrix {
    matrix(py, horizon.n_strings(), kilowatts(horizon.signed(request_w)))
}
