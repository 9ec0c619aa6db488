//! Python binding: conversion, release of the interpreter lock, error mapping; no numerics.
//!
//! One file for what Python holds of each thing: `system` (its tables), `plant` and `ageing` of `bess-plant`; `model`,
//! `horizon` with its `answers`, `plan`, `dispatch`, `rule` and `explicit` of `bess-control`. `arrays` converts,
//! `states` and `flows` are parts of more than one answer.

use pyo3::prelude::*;

mod ageing;
mod answers;
mod arrays;
mod dispatch;
mod explicit;
mod flows;
mod horizon;
mod model;
mod nodes;
mod plan;
mod plant;
mod rule;
mod states;
mod system;

/// Compiled core of bess.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::ageing::{ageing_models, rainflow, Ageing};
    #[pymodule_export]
    use crate::answers::{GroupBounds, Incumbent, SplitAnswer, StepBounds, TightenedBounds};
    #[pymodule_export]
    use crate::dispatch::Store;
    #[pymodule_export]
    use crate::explicit::Explicit;
    #[pymodule_export]
    use crate::flows::FlowArrays;
    #[pymodule_export]
    use crate::horizon::ControlHorizon;
    #[pymodule_export]
    use crate::model::{BestShares, ControlModel, TrackedArrays};
    #[pymodule_export]
    use crate::nodes::Node;
    #[pymodule_export]
    use crate::plan::{plan, Plan};
    #[pymodule_export]
    use crate::plant::{cooling_kinds, Plant};
    #[pymodule_export]
    use crate::rule::{water_fill, Rule};
    #[pymodule_export]
    use crate::states::StateBoxes;
    #[pymodule_export]
    use crate::system::System;
}
