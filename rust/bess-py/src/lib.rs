//! Python binding: conversion, release of the interpreter lock, error mapping; no numerics.
//!
//! `plant` and `ageing` bind `bess-plant`; `model`, `horizon`, `node`, `plan`, `dispatch` and `laws` bind `bess-control`.
//! `arrays` converts.

#![allow(clippy::too_many_arguments)] // Arguments are those of Python.

use pyo3::prelude::*;

mod ageing;
mod arrays;
mod dispatch;
mod horizon;
mod laws;
mod model;
mod node;
mod plan;
mod plant;

/// Compiled core of bess.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::{
        ageing::{ageing_models, rainflow, Ageing},
        dispatch::Store,
        horizon::{ControlHorizon, GroupBounds, Incumbent, SplitAnswer, StepBounds},
        laws::{water_fill, Explicit, Rule},
        model::{BestShares, ControlModel, FlowArrays, System, TrackedArrays},
        node::{Node, StateBoxes},
        plan::{plan, Plan},
        plant::{cooling_kinds, Plant},
    };
}
