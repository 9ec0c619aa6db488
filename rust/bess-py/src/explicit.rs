//! The law of an explicit controller: single steps, and closed loops over the plant.

use bess_control::{ControlError, ExplicitLaw, Measured, Tables, N_OUTLOOK, N_WEIGHTS};
use bess_plant::{PlantState, Record};
use bess_tables::units::W_PER_KW;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{
    check_shape, matrix, numbers, refused, vector, GivenCube, GivenMatrix, GivenVector, Matrix, Vector,
};
use crate::plant::{to_dict, Plant};

/// The law of an explicit controller, without its weights.
#[pyclass(frozen, module = "bess._core")]
pub struct Explicit {
    inner: ExplicitLaw,
}

#[pymethods]
impl Explicit {
    /// From tables by name.
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

    /// Weights of a law.
    #[classattr]
    const N_WEIGHTS: usize = N_WEIGHTS;

    /// Outlook of each schedule of demand `(N, steps)` [kW], `(N, numbers)`.
    fn look(&self, py: Python<'_>, ahead_kw: GivenMatrix<'_>) -> PyResult<Matrix> {
        let (rows, n_steps) = (ahead_kw.shape()[0], self.inner.n_steps());
        check_shape("demand", &[rows, n_steps], ahead_kw.shape())?;
        let mut outlook = Vec::with_capacity(rows * N_OUTLOOK);
        for schedule in numbers(&ahead_kw).chunks_exact(n_steps) {
            outlook.extend(self.inner.look(schedule).map_err(refused)?);
        }
        Ok(matrix(py, rows, outlook))
    }

    /// Set-points of one step `(M,)` [kW]; `ahead_kw` `(steps,)` begins with its demand.
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
        let outlook = self.inner.look(&ahead_kw).map_err(refused)?;
        let measured = Measured {
            soc: &numbers(&soc),
            temperature_c: &numbers(&temperature_c),
            soh_capacity: &numbers(&soh_capacity),
            soh_resistance: &numbers(&soh_resistance),
            limit_kw: &numbers(&limit_kw),
        };
        let mut request_kw = vec![0.0; self.inner.n_strings()];
        let shared = self.inner.split(&numbers(&weights), &measured, ahead_kw[0], &outlook, &mut request_kw);
        shared.map_err(refused)?;
        Ok(vector(py, request_kw))
    }

    /// Runs the closed loop over `plant` with one set of weights for each of its scenarios `(S, weights)`.
    ///
    /// `demand_kw` `(T, S)`, never above the sum of `limit_kw` `(T, M)`; `outlook` `(T, S, numbers)`, `ambient_c` `(T, S)`.
    /// Gives the record of `Plant.run`, and `request_kw`, flat in the order (step, scenario, string).
    #[allow(clippy::too_many_arguments)]
    fn run<'py>(
        &self,
        py: Python<'py>,
        plant: &mut Plant,
        weights: GivenMatrix<'py>,
        demand_kw: GivenMatrix<'py>,
        outlook: GivenCube<'py>,
        limit_kw: GivenMatrix<'py>,
        ambient_c: GivenMatrix<'py>,
        duration_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n_strings = self.inner.n_strings();
        let (steps, scenarios) = (demand_kw.shape()[0], demand_kw.shape()[1]);
        check_shape("lanes of the plant", &[scenarios * n_strings], &[plant.inner.lanes()])?;
        check_shape("weights", &[scenarios, N_WEIGHTS], weights.shape())?;
        check_shape("outlook", &[steps, scenarios, N_OUTLOOK], outlook.shape())?;
        check_shape("limit", &[steps, n_strings], limit_kw.shape())?;
        check_shape("ambient_c", &[steps, scenarios], ambient_c.shape())?;
        let asked = Asked {
            scenarios,
            weights: numbers(&weights),
            demand_kw: numbers(&demand_kw),
            outlook: numbers(&outlook),
            limit_kw: numbers(&limit_kw),
        };
        let (ambient_c, cooled) = (numbers(&ambient_c), plant.inner.is_cooled());
        let (law, plant) = (&self.inner, &mut plant.inner);
        let run = || -> PyResult<(Option<Record>, Vec<f64>)> {
            let mut record: Option<Record> = None;
            let mut requests_kw = Vec::new();
            for (t, ambient_c) in ambient_c.chunks_exact(scenarios.max(1)).enumerate() {
                let request_kw = asked.request_kw(law, &plant.state(), t).map_err(refused)?;
                let request_w: Vec<f64> = request_kw.iter().map(|p| p * W_PER_KW).collect();
                let step = plant.run(&request_w, ambient_c, duration_s, false).map_err(refused)?;
                requests_kw.extend(request_kw);
                match &mut record {
                    Some(record) => record.append(step),
                    None => record = Some(step),
                }
            }
            Ok((record, requests_kw))
        };
        let (record, request_kw) = py.detach(run)?;
        let record = record.ok_or_else(|| PyValueError::new_err("demand: needs at least one step"))?;
        let out = to_dict(py, record, cooled)?;
        out.set_item("request_kw", vector(py, request_kw))?;
        Ok(out)
    }
}

/// What closed loops are asked, flat: step by step, scenario by scenario.
struct Asked {
    scenarios: usize,
    weights: Vec<f64>,
    demand_kw: Vec<f64>,
    outlook: Vec<f64>,
    limit_kw: Vec<f64>,
}

impl Asked {
    /// Set-points of all lanes in step `t` [kW], from what a controller measures when the step begins: so it makes no
    /// difference where a run is interrupted.
    fn request_kw(&self, law: &ExplicitLaw, state: &PlantState, t: usize) -> Result<Vec<f64>, ControlError> {
        let n = law.n_strings();
        let temperature_c = state.mean_temperature_c();
        let health = || state.ageing.iter().map(|ageing| ageing.loss());
        let soh_capacity: Vec<f64> = health().map(|loss| loss.soh_capacity).collect();
        let soh_resistance: Vec<f64> = health().map(|loss| loss.soh_resistance).collect();
        let mut request_kw = vec![0.0; self.scenarios * n];
        for (s, request_kw) in request_kw.chunks_exact_mut(n).enumerate() {
            let (at, own) = (t * self.scenarios + s, s * n..(s + 1) * n);
            if self.demand_kw[at] == 0.0 {
                continue;
            }
            let measured = Measured {
                soc: &state.soc[own.clone()],
                temperature_c: &temperature_c[own.clone()],
                soh_capacity: &soh_capacity[own.clone()],
                soh_resistance: &soh_resistance[own],
                limit_kw: &self.limit_kw[t * n..(t + 1) * n],
            };
            let weights = &self.weights[s * N_WEIGHTS..][..N_WEIGHTS];
            let outlook = self.outlook[at * N_OUTLOOK..][..N_OUTLOOK].try_into().expect("its length");
            law.split(weights, &measured, self.demand_kw[at], outlook, request_kw)?;
        }
        Ok(request_kw)
    }
}
