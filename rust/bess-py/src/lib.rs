//! Python binding: conversion, release of the interpreter lock, error mapping; no numerics.
//!
//! One file for what Python holds of each thing: `system` (its tables), `plant` and `ageing` of `bess-plant`; `model`,
//! `horizon` with its `answers`, `plan` and `explicit` of `bess-control`. `arrays` converts, `states`, `flows` and `follow` are
//! results in more than one answer.

use pyo3::prelude::*;

mod ageing;
mod answers;
mod arrays;
mod explicit;
mod flows;
mod follow;
mod horizon;
mod model;
mod nodes;
mod plan;
mod plant;
mod states;
mod system;

/// Compiled core of bess.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::ageing::{ageing_models, rainflow, Ageing};
    #[pymodule_export]
    use crate::answers::{
        CoefficientRanges, GroupBounds, Incumbent, SplitAnswer, StepBounds, TightenedBounds,
    };
    #[pymodule_export]
    use crate::explicit::Explicit;
    #[pymodule_export]
    use crate::flows::FlowArrays;
    #[pymodule_export]
    use crate::follow::{BestShares, FollowedArrays};
    #[pymodule_export]
    use crate::horizon::ControlHorizon;
    #[pymodule_export]
    use crate::model::ControlModel;
    #[pymodule_export]
    use crate::nodes::Node;
    #[pymodule_export]
    use crate::plan::{plan, Plan};
    #[pymodule_export]
    use crate::plant::{cooling_kinds, Plant};
    #[pymodule_export]
    use crate::states::StateBoxes;
    #[pymodule_export]
    use crate::system::System;
}
