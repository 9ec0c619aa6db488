use std::sync::Arc;

use numpy::PyReadonlyArray1;
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

    /// The same plant with the capacity and the resistance of each string times a factor.
    fn aged(
        &self,
        soh_capacity: PyReadonlyArray1<'_, f64>,
        soh_resistance: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let inner = self
            .inner
            .aged(&soh_capacity.as_array().to_vec(), &soh_resistance.as_array().to_vec())
            .map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Number of strings.
    #[getter]
    fn n_strings(&self) -> usize {
        self.inner.strings.len()
    }
}
