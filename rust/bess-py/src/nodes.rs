//! Nodes of the branch and bound.

use bess_control::{NarrowNode, Node as Part, Range};
use bess_tables::units::W_PER_KW;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{flags, matrix, Flags, Matrix};
use crate::states::StateBoxes;

/// A set of schedules: ranges of the requests `(M, T)` and of the states `(M, T + 1)`.
#[pyclass(frozen, module = "bess._core")]
pub struct Node {
    pub(crate) n_strings: usize,
    pub(crate) inner: Part,
    /// Operating ranges of the strings in a tightened node.
    pub(crate) narrowed: Option<NarrowNode>,
}

impl Node {
    pub(crate) fn of(n_strings: usize, narrowed: NarrowNode) -> Self {
        Self { n_strings, inner: narrowed.node.clone(), narrowed: Some(narrowed) }
    }

    fn pick(&self, py: Python<'_>, of: fn(&Range) -> f64) -> Matrix {
        matrix(py, self.n_strings, self.inner.requests_w.iter().map(|r| of(r) / W_PER_KW).collect())
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
        flags(py, self.n_strings, self.inner.may_shed.clone())
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

    /// The parts of a narrowed node in which one string sheds nothing in one step, and in which it ends this
    /// step full (empty) enough to shed.
    fn branch_on_full(&self, string: usize, step: usize) -> PyResult<(Self, Self)> {
        self.check(string, step, 0.0)?;
        let narrowed = self.narrowed.as_ref().ok_or_else(|| PyValueError::new_err("node: not narrowed"))?;
        let cell = narrowed.cells[string * (narrowed.cells.len() / self.n_strings) + step];
        Ok(self.parts(self.inner.branch_on_full(string, step, cell.shed_soc)))
    }

    /// The parts below and above an SOC of one string at the start of one step.
    fn branch_on_soc(&self, string: usize, step: usize, at: f64) -> PyResult<(Self, Self)> {
        self.check(string, step, at)?;
        Ok(self.parts(self.inner.branch_on_soc(string, step, at)))
    }
}

impl Node {
    fn check(&self, string: usize, step: usize, at: f64) -> PyResult<()> {
        let n_steps = self.inner.requests_w.len() / self.n_strings.max(1);
        if string < self.n_strings && step < n_steps && at.is_finite() {
            return Ok(());
        }
        let range = format!("{} strings, {n_steps} steps, at a finite value", self.n_strings);
        Err(PyValueError::new_err(format!("branch: string {string}, step {step}, at {at}: {range}")))
    }

    fn parts(&self, [below, above]: [Part; 2]) -> (Self, Self) {
        let of = |inner| Self { n_strings: self.n_strings, inner, narrowed: None };
        (of(below), of(above))
    }
}
