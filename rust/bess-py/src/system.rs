//! The tables of a plant.

use std::sync::Arc;

use pyo3::prelude::*;

use crate::arrays::{numbers, refused, GivenVector};

/// Tables of a plant, shared by every object built from it.
#[pyclass(frozen, module = "bess._core")]
pub struct System {
    pub(crate) inner: Arc<bess_tables::System>,
}

#[pymethods]
impl System {
    /// Creates the tables from the resolved description, JSON of `{"strings": [...]}`.
    #[new]
    fn new(document: &str) -> PyResult<Self> {
        let inner = bess_tables::System::from_json(document).map_err(refused)?;
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Returns a copy with the capacity and resistance of each string scaled by these factors.
    fn aged(&self, soh_capacity: GivenVector<'_>, soh_resistance: GivenVector<'_>) -> PyResult<Self> {
        let inner = self.inner.aged(&numbers(&soh_capacity), &numbers(&soh_resistance)).map_err(refused)?;
        Ok(Self { inner: Arc::new(inner) })
    }
}
