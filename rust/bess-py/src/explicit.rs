//! Law of an explicit controller: single steps, and closed loops over the plant.

use bess_control::{ExplicitLaw, Measured, Tables, DECISION, N_FEATURES, N_WEIGHTS};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{
    check_shape, matrix, numbers, refused, vector, GivenCube, GivenMatrix, GivenVector, Matrix, Vector,
};
use crate::plant::Plant;
use crate::rule::closed_loop;

/// The law of an explicit controller, without its weights.
#[pyclass(frozen, module = "bess._core")]
pub struct Explicit {
    inner: ExplicitLaw,
}

#[pymethods]
impl Explicit {
    /// Creates the law from tables by name.
    #[new]
    fn new(tables: &Bound<'_, PyDict>) -> PyResult<Self> {
        let item = |name: &str| {
            tables.get_item(name)?.ok_or_else(|| PyValueError::new_err(format!("{name} is missing")))
        };
        let tables = Tables::read(
            |name| item(name)?.extract(),
            |name| item(name)?.extract(),
            |name| item(name)?.extract(),
        )?;
        Ok(Self { inner: ExplicitLaw::new(tables).map_err(refused)? })
    }

    #[classattr]
    const N_WEIGHTS: usize = N_WEIGHTS;

    /// Source text of the control law.
    #[classattr]
    const DECISION: &'static str = DECISION;

    /// Demand features `(N, numbers)` of each demand forecast `(N, steps)` [kW].
    fn demand_features(&self, py: Python<'_>, ahead_kw: GivenMatrix<'_>) -> PyResult<Matrix> {
        let (rows, n_steps) = (ahead_kw.shape()[0], self.inner.n_steps());
        check_shape("demand", &[rows, n_steps], ahead_kw.shape())?;
        let mut features = Vec::with_capacity(rows * N_FEATURES);
        for schedule in numbers(&ahead_kw).chunks_exact(n_steps) {
            features.extend(self.inner.demand_features(schedule).map_err(refused)?);
        }
        Ok(matrix(py, rows, features))
    }

    /// Set-points of one step `(M,)` [kW]; `ahead_kw` `(steps,)` begins with the demand of this step.
    #[allow(clippy::too_many_arguments)]
    fn split(
        &self,
        py: Python<'_>,
        weights: GivenVector<'_>,
        soc: GivenVector<'_>,
        temperature_c: GivenVector<'_>,
        soh_capacity: GivenVector<'_>,
        soh_resistance: GivenVector<'_>,
        limit_kw: GivenVector<'_>,
        ahead_kw: GivenVector<'_>,
    ) -> PyResult<Vector> {
        let ahead_kw = numbers(&ahead_kw);
        let features = self.inner.demand_features(&ahead_kw).map_err(refused)?;
        let measured = Measured {
            soc: &numbers(&soc),
            temperature_c: &numbers(&temperature_c),
            soh_capacity: &numbers(&soh_capacity),
            soh_resistance: &numbers(&soh_resistance),
            limit_kw: &numbers(&limit_kw),
        };
        let request_kw = self.inner.split(&numbers(&weights), &measured, ahead_kw[0], &features);
        Ok(vector(py, request_kw.map_err(refused)?))
    }

    /// Runs the closed loop over `plant` with one set of weights for each of its scenarios `(S, weights)`.
    ///
    /// `demand_kw` `(T, S)`, never above the sum of `limit_kw` `(T, M)`; `features` `(T, S, numbers)`, `ambient_c` `(T, S)`.
    /// Returns the record of `Plant.run`, and `request_kw`, flat in the order (step, scenario, string).
    #[allow(clippy::too_many_arguments)]
    fn run<'py>(
        &self,
        py: Python<'py>,
        plant: &mut Plant,
        weights: GivenMatrix<'py>,
        demand_kw: GivenMatrix<'py>,
        features: GivenCube<'py>,
        limit_kw: GivenMatrix<'py>,
        ambient_c: GivenMatrix<'py>,
        duration_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n_strings = self.inner.n_strings();
        let (steps, scenarios) = (demand_kw.shape()[0], demand_kw.shape()[1]);
        check_shape("lanes of the plant", &[scenarios * n_strings], &[plant.inner.lanes()])?;
        check_shape("weights", &[scenarios, N_WEIGHTS], weights.shape())?;
        check_shape("features", &[steps, scenarios, N_FEATURES], features.shape())?;
        check_shape("limit", &[steps, n_strings], limit_kw.shape())?;
        check_shape("ambient_c", &[steps, scenarios], ambient_c.shape())?;
        let (weights, demand_kw, features) = (numbers(&weights), numbers(&demand_kw), numbers(&features));
        let split = |measured: &Measured<'_>, t: usize, s: usize| {
            let at = t * scenarios + s;
            if demand_kw[at] == 0.0 {
                return Ok(vec![0.0; n_strings]);
            }
            let weights = &weights[s * N_WEIGHTS..][..N_WEIGHTS];
            let features = features[at * N_FEATURES..][..N_FEATURES].try_into().expect("its length");
            self.inner.split(weights, measured, demand_kw[at], features).map_err(refused)
        };
        closed_loop(py, plant, scenarios, &numbers(&limit_kw), &numbers(&ambient_c), duration_s, split)
    }
}
