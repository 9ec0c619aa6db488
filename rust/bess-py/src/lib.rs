//! Python binding: convert, detach from the interpreter, map errors. No numerics live here.

use pyo3::prelude::*;

mod ageing;
mod arrays;
mod explicit;
mod follow;
mod horizon;
mod model;
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
    use crate::explicit::Explicit;
    #[pymodule_export]
    use crate::follow::{BestShares, FollowedArrays};
    #[pymodule_export]
    use crate::horizon::{
        CoefficientBounds, Confined, ControlHorizon, GroupBounds, Incumbent, SplitAnswer, StepCuts,
    };
    #[pymodule_export]
    use crate::model::{ControlModel, FlowArrays, RolloutArrays};
    #[pymodule_export]
    use crate::plan::{plan, Plan};
    #[pymodule_export]
    use crate::plant::{cooling_kinds, Plant};
    #[pymodule_export]
    use crate::states::StateBoxes;
    #[pymodule_export]
    use crate::system::System;
}
