use std::sync::Arc;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Tables of a plant, shared by every object built from it.
#[pyclass(frozen, module = "bess._core")]
pub struct System {
    pub(crate) inner: Arc<bess_tables::System>,
}

#[pymethods]
impl System {
    /// From the resolved description, JSON of `{"strings": [...]}`.
    #[new]
    fn new(document: &str) -> PyResult<Self> {
        let inner = bess_tables::System::from_json(document)
            .map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Number of strings.
    #[getter]
    fn n_strings(&self) -> usize {
        self.inner.strings.len()
    }
}
