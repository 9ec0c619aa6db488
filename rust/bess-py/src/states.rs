//! Boxes of states, as arrays.

use bess_control::{Range, StateBox, StringState};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{check_shape, matrix, numbers, GivenMatrix, Matrix};

/// Ranges of the state of every string `(M, N)` at the start of each step, optionally also at the end of the
/// last.
#[pyclass(frozen, module = "bess._core")]
pub struct StateBoxes {
    pub(crate) n_strings: usize,
    pub(crate) boxes: Vec<StateBox>,
}

impl StateBoxes {
    /// Boxes at the starts of `n_steps` steps.
    pub(crate) fn at_starts(&self, n_strings: usize, n_steps: usize) -> PyResult<Vec<StateBox>> {
        let columns = self.boxes.len() / self.n_strings.max(1);
        if columns == n_steps + 1 {
            check_shape("states", &[n_strings, columns], &[self.n_strings, columns])?;
            return Ok(self.boxes.chunks_exact(columns).flat_map(|row| row[..n_steps].to_vec()).collect());
        }
        check_shape("states", &[n_strings, n_steps], &[self.n_strings, columns])?;
        Ok(self.boxes.clone())
    }

    /// States at the starts of `n_steps` steps, of boxes that are points.
    pub(crate) fn points(&self, n_strings: usize, n_steps: usize) -> PyResult<Vec<StringState>> {
        let state = |b: &StateBox| StringState { soc: b.soc.low, temperature_c: b.temperature_c.low };
        Ok(self.at_starts(n_strings, n_steps)?.iter().map(state).collect())
    }

    fn pick(&self, py: Python<'_>, of: fn(&StateBox) -> f64) -> Matrix {
        matrix(py, self.n_strings, self.boxes.iter().map(of).collect())
    }
}

#[pymethods]
impl StateBoxes {
    #[new]
    fn new(
        soc_low: GivenMatrix<'_>,
        soc_high: GivenMatrix<'_>,
        temperature_low_c: GivenMatrix<'_>,
        temperature_high_c: GivenMatrix<'_>,
    ) -> PyResult<Self> {
        let shape = soc_low.shape().to_vec();
        let arrays = [soc_low, soc_high, temperature_low_c, temperature_high_c];
        for array in &arrays {
            check_shape("states", &shape, array.shape())?;
        }
        let [soc_low, soc_high, t_low, t_high] = arrays.map(|array| numbers(&array));
        let boxes: PyResult<Vec<_>> = (0..soc_low.len())
            .map(|i| {
                let soc = Range { low: soc_low[i], high: soc_high[i] };
                let temperature_c = Range { low: t_low[i], high: t_high[i] };
                if soc.low <= soc.high && temperature_c.low <= temperature_c.high {
                    Ok(StateBox { soc, temperature_c })
                } else {
                    Err(PyValueError::new_err(format!("states: empty box or NaN at position {i}")))
                }
            })
            .collect();
        Ok(Self { n_strings: shape[0], boxes: boxes? })
    }

    /// Lower end of the SOC.
    #[getter]
    fn soc_low(&self, py: Python<'_>) -> Matrix {
        self.pick(py, |b| b.soc.low)
    }

    /// Upper end of the SOC.
    #[getter]
    fn soc_high(&self, py: Python<'_>) -> Matrix {
        self.pick(py, |b| b.soc.high)
    }

    /// Lower end of the mean temperature [degC].
    #[getter]
    fn temperature_low_c(&self, py: Python<'_>) -> Matrix {
        self.pick(py, |b| b.temperature_c.low)
    }

    /// Upper end of the mean temperature [degC].
    #[getter]
    fn temperature_high_c(&self, py: Python<'_>) -> Matrix {
        self.pick(py, |b| b.temperature_c.high)
    }
}
