//! Nodes of the branch and bound, and boxes of states.

use bess_control::{Node as Part, Range, StateBox};
use bess_tables::units::W_PER_KW;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{check_shape, matrix, numbers, Flags, Matrix, MatrixIn};

/// Ranges of the state of every string `(M, N)` at the start of each step, optionally also at the end of the last.
#[pyclass(frozen, module = "bess._core")]
pub struct StateBoxes {
    pub(crate) n_strings: usize,
    pub(crate) boxes: Vec<StateBox>,
}

impl StateBoxes {
    /// Number of states of a string.
    pub(crate) fn n_states(&self) -> usize {
        self.boxes.len() / self.n_strings.max(1)
    }

    fn pick(&self, py: Python<'_>, of: fn(&StateBox) -> f64) -> Matrix {
        matrix(py, self.n_strings, self.boxes.iter().map(of).collect())
    }
}

#[pymethods]
impl StateBoxes {
    #[new]
    fn new(
        soc_low: MatrixIn<'_>,
        soc_high: MatrixIn<'_>,
        temperature_low_c: MatrixIn<'_>,
        temperature_high_c: MatrixIn<'_>,
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

/// A set of schedules: ranges of the requests `(M, T)` and of the states `(M, T + 1)`.
#[pyclass(frozen, module = "bess._core")]
pub struct Node {
    pub(crate) n_strings: usize,
    pub(crate) inner: Part,
}

impl Node {
    fn pick(&self, py: Python<'_>, of: fn(&Range) -> f64) -> Matrix {
        matrix(py, self.n_strings, self.inner.requests_w.iter().map(|r| of(r) / W_PER_KW).collect())
    }

    fn parts(&self, [below, above]: [Part; 2]) -> (Self, Self) {
        let of = |inner| Self { n_strings: self.n_strings, inner };
        (of(below), of(above))
    }

    /// Checks that a node has these strings and steps.
    pub(crate) fn check_shape(&self, shape: &[usize]) -> PyResult<()> {
        let n_steps = self.inner.may_shed.len() / self.n_strings.max(1);
        check_shape("node", shape, &[self.n_strings, n_steps])
    }

    fn check(&self, string: usize, step: usize, at: f64) -> PyResult<()> {
        let n_steps = self.inner.requests_w.len() / self.n_strings.max(1);
        if string < self.n_strings && step < n_steps && at.is_finite() {
            return Ok(());
        }
        let range = format!("{} strings, {n_steps} steps, at a finite value", self.n_strings);
        Err(PyValueError::new_err(format!("branch: string {string}, step {step}, at {at}: {range}")))
    }

    /// The ranges of a tightened node.
    pub(crate) fn tightened(&self) -> PyResult<&Part> {
        if self.inner.cells.is_empty() {
            return Err(PyValueError::new_err("node: not tightened"));
        }
        Ok(&self.inner)
    }
}

#[pymethods]
impl Node {
    /// Minimum request, a magnitude [kW].
    #[getter]
    fn request_low_kw(&self, py: Python<'_>) -> Matrix {
        self.pick(py, |r| r.low)
    }

    /// Maximum request, a magnitude [kW].
    #[getter]
    fn request_high_kw(&self, py: Python<'_>) -> Matrix {
        self.pick(py, |r| r.high)
    }

    /// Whether a string may have availability loss in a step.
    #[getter]
    fn may_shed(&self, py: Python<'_>) -> Flags {
        matrix(py, self.n_strings, self.inner.may_shed.clone())
    }

    /// Boxes of the states `(M, T + 1)`.
    #[getter]
    fn boxes(&self) -> StateBoxes {
        StateBoxes { n_strings: self.n_strings, boxes: self.inner.boxes.clone() }
    }

    /// The parts below and above a request of one string in one step, a magnitude [kW].
    fn branch_on_request(&self, string: usize, step: usize, at_kw: f64) -> PyResult<(Self, Self)> {
        self.check(string, step, at_kw)?;
        Ok(self.parts(self.inner.branch_on_request(string, step, at_kw * W_PER_KW)))
    }

    /// The parts of a tightened node in which one string sheds nothing in one step, and in which it ends this
    /// step full (empty) enough to shed.
    fn branch_on_full(&self, string: usize, step: usize) -> PyResult<(Self, Self)> {
        self.check(string, step, 0.0)?;
        Ok(self.parts(self.tightened()?.branch_on_full(string, step)))
    }

    /// The parts below and above an SOC of one string at the start of one step.
    fn branch_on_soc(&self, string: usize, step: usize, at: f64) -> PyResult<(Self, Self)> {
        self.check(string, step, at)?;
        Ok(self.parts(self.inner.branch_on_soc(string, step, at)))
    }
}
