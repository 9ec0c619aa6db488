//! Tracking of a demand on the whole plant.

use bess_control::TrackedDemand;
use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;

use crate::arrays::{
    check_shape, kilowatts, matrix, refused, vector, watts, GivenMatrix, GivenVector, Matrix, Vector,
};

/// Allocation of plant powers to strings `(P, M)` [kW], in charge and in discharge, at uniform powers from
/// zero to the sum of `limit_kw` `(M,)`.
#[pyclass(frozen, module = "bess._core")]
pub struct BestShares {
    pub(crate) inner: bess_control::BestShares,
}

#[pymethods]
impl BestShares {
    #[new]
    fn new(
        charge_kw: GivenMatrix<'_>,
        discharge_kw: GivenMatrix<'_>,
        limit_kw: GivenVector<'_>,
    ) -> PyResult<Self> {
        check_shape("charge", &[charge_kw.shape()[0], limit_kw.len()], charge_kw.shape())?;
        check_shape("discharge", charge_kw.shape(), discharge_kw.shape())?;
        let inner = bess_control::BestShares::new(watts(&charge_kw), watts(&discharge_kw), watts(&limit_kw));
        Ok(Self { inner: inner.map_err(refused)? })
    }
}

/// Result of tracking: allocated and delivered power `(T,)`, requests of the strings `(M, T)` [kW, positive =
/// discharge], and the states at the start and at the end of each step `(M, T + 1)`.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct FollowedArrays {
    asked_kw: Vector,
    delivered_kw: Vector,
    request_kw: Matrix,
    soc: Matrix,
    temperature_c: Matrix,
}

impl FollowedArrays {
    pub(crate) fn new(py: Python<'_>, n_strings: usize, of: TrackedDemand) -> Self {
        Self {
            asked_kw: vector(py, kilowatts(of.asked_w)),
            delivered_kw: vector(py, kilowatts(of.delivered_w)),
            request_kw: matrix(py, n_strings, kilowatts(of.request_w)),
            soc: matrix(py, n_strings, of.soc),
            temperature_c: matrix(py, n_strings, of.temperature_c),
        }
    }
}
