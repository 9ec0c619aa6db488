//! Python binding: convert, detach from the interpreter, map errors. No numerics live here.

use pyo3::prelude::*;

mod ageing;
mod control;
mod plant;
mod system;

/// Compiled core of bess.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::ageing::{ageing_models, rainflow, Ageing};
    #[pymodule_export]
    use crate::control::{ControlHorizon, ControlModel};
    #[pymodule_export]
    use crate::plant::Plant;
    #[pymodule_export]
    use crate::system::System;
}
