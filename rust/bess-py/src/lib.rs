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
    use crate::{
        ageing::{ageing_models, rainflow, Ageing},
        answers::{GroupBounds, Incumbent, SplitAnswer, StepBounds, TightenedBounds},
        dispatch::Store,
        explicit::Explicit,
        flows::FlowArrays,
        horizon::ControlHorizon,
        model::{BestShares, ControlModel, TrackedArrays},
        nodes::Node,
        plan::{plan, Plan},
        plant::{cooling_kinds, Plant},
        rule::{water_fill, Rule},
        states::StateBoxes,
        system::System,
    };
}
