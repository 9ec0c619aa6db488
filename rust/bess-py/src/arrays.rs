//! Conversion of arrays between Python and Rust: shapes, units and errors.

use std::fmt::Display;

use bess_tables::units::W_PER_KW;
use numpy::ndarray::{Array1, Array2, ArrayD, Dimension};
use numpy::{Element, IntoPyArray, Ix1, Ix2, Ix3, PyArray1, PyArray2, PyArrayDyn, PyReadonlyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Numeric array from Python.
pub(crate) type ArrayIn<'py, D> = PyReadonlyArray<'py, f64, D>;
pub(crate) type VectorIn<'py> = ArrayIn<'py, Ix1>;
pub(crate) type MatrixIn<'py> = ArrayIn<'py, Ix2>;
pub(crate) type CubeIn<'py> = ArrayIn<'py, Ix3>;

/// Array returned to Python.
pub(crate) type Vector = Py<PyArray1<f64>>;
pub(crate) type Matrix = Py<PyArray2<f64>>;
pub(crate) type Flags = Py<PyArray2<bool>>;
pub(crate) type Numbers = Py<PyArrayDyn<f64>>;

/// Converts an error of a crate to a `ValueError` with its message.
pub(crate) fn value_error(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Values in row-major order.
pub(crate) fn numbers<D: Dimension>(array: &ArrayIn<'_, D>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

/// Values in row-major order, times `factor`.
pub(crate) fn scaled<D: Dimension>(array: &ArrayIn<'_, D>, factor: f64) -> Vec<f64> {
    array.as_array().iter().map(|v| v * factor).collect()
}

/// Converts kW, kvar or kVA to W, var or VA.
pub(crate) fn watts<D: Dimension>(array: &ArrayIn<'_, D>) -> Vec<f64> {
    scaled(array, W_PER_KW)
}

/// Inverse of [`watts`].
pub(crate) fn kilowatts(values: Vec<f64>) -> Vec<f64> {
    values.into_iter().map(|v| v / W_PER_KW).collect()
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

pub(crate) fn matrix<T: Element>(py: Python<'_>, rows: usize, values: Vec<T>) -> Py<PyArray2<T>> {
    let shape = (rows, values.len() / rows.max(1));
    Array2::from_shape_vec(shape, values).expect("whole rows").into_pyarray(py).unbind()
}

pub(crate) fn shaped(py: Python<'_>, shape: &[usize], values: Vec<f64>) -> Numbers {
    ArrayD::from_shape_vec(shape, values).expect("one value for each place").into_pyarray(py).unbind()
}
