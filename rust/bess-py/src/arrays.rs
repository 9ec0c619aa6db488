//! Arrays on their way in and out: shapes checked, units converted.

use bess_control::ControlError;
use numpy::ndarray::{Array1, Array2, Array3, ArrayView, Dimension};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pub(crate) type Vector = Py<PyArray1<f64>>;
pub(crate) type Matrix = Py<PyArray2<f64>>;
pub(crate) type Flags = Py<PyArray2<bool>>;
pub(crate) type Cube = Py<PyArray3<f64>>;

pub(crate) fn refused(error: ControlError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

pub(crate) fn flat<D: Dimension>(array: ArrayView<'_, f64, D>, factor: f64) -> Vec<f64> {
    array.iter().map(|v| v * factor).collect()
}

pub(crate) fn check_shape(name: &str, needed: &[usize], given: &[usize]) -> PyResult<()> {
    if needed == given {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name}: needs shape {needed:?}, has {given:?}")))
}

pub(crate) fn vector(py: Python<'_>, values: Vec<f64>) -> Vector {
    Array1::from_vec(values).into_pyarray(py).unbind()
}

pub(crate) fn matrix(py: Python<'_>, rows: usize, values: Vec<f64>) -> Matrix {
    let shape = (rows, values.len() / rows.max(1));
    Array2::from_shape_vec(shape, values).expect("whole rows").into_pyarray(py).unbind()
}

pub(crate) fn flags(py: Python<'_>, rows: usize, values: Vec<bool>) -> Flags {
    let shape = (rows, values.len() / rows.max(1));
    Array2::from_shape_vec(shape, values).expect("whole rows").into_pyarray(py).unbind()
}

pub(crate) fn cube(py: Python<'_>, shape: (usize, usize, usize), values: Vec<f64>) -> Cube {
    Array3::from_shape_vec(shape, values).expect("one value for each place").into_pyarray(py).unbind()
}
