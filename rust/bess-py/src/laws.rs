//! Rules and explicit controllers: single steps, and closed loops over the plant.

use bess_control::{ExplicitLaw, Measured, Rule as Kind, RuleLaw, Tables, DECISION, N_FEATURES, N_WEIGHTS};
use bess_plant::Record;
use bess_tables::units::W_PER_KW;
use bess_tables::InputError;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{
    check_shape, matrix, numbers, value_error, vector, CubeIn, Matrix, MatrixIn, Vector, VectorIn,
};
use crate::model::System;
use crate::plant::{to_dict, Plant};

/// Allocates `total_kw` in proportion to `weights` up to `caps_kw` `(M,)`.
#[pyfunction]
pub fn water_fill(
    py: Python<'_>,
    total_kw: f64,
    weights: VectorIn<'_>,
    caps_kw: VectorIn<'_>,
) -> PyResult<Vector> {
    check_shape("weights", caps_kw.shape(), weights.shape())?;
    Ok(vector(py, bess_control::water_fill(total_kw, &numbers(&weights), &numbers(&caps_kw))))
}

/// Attributes of a `bess.State`: measurements of each string `(M,)`.
#[derive(FromPyObject)]
struct State<'py> {
    soc: VectorIn<'py>,
    temperature_c: VectorIn<'py>,
    soh_capacity: VectorIn<'py>,
    soh_resistance: VectorIn<'py>,
}

impl State<'_> {
    /// `split` of this state and the maximum power of each inverter.
    fn apply<T>(&self, limit_kw: &VectorIn<'_>, split: impl FnOnce(&Measured<'_>) -> T) -> T {
        split(&Measured {
            soc: &numbers(&self.soc),
            temperature_c: &numbers(&self.temperature_c),
            soh_capacity: &numbers(&self.soh_capacity),
            soh_resistance: &numbers(&self.soh_resistance),
            limit_kw: &numbers(limit_kw),
        })
    }
}

/// A rule that allocates the demand of each step.
#[pyclass(frozen, module = "bess._core")]
pub struct Rule {
    inner: RuleLaw,
}

#[pymethods]
impl Rule {
    /// `name` is that of the policy; arrays `(M,)`: nominal power [kW] and energy [kWh], temperature of full derating [degC].
    #[new]
    fn new(
        system: &System,
        name: &str,
        dt_h: f64,
        nominal_kw: VectorIn<'_>,
        nominal_energy_kwh: VectorIn<'_>,
        stop_c: VectorIn<'_>,
    ) -> PyResult<Self> {
        let rule = match name {
            "equal" => Kind::Equal,
            "priority" => Kind::Priority,
            "soc" => Kind::Soc,
            "temperature" => Kind::Temperature,
            other => return Err(PyValueError::new_err(format!("rule '{other}' is not known"))),
        };
        let sizes = [nominal_kw, nominal_energy_kwh, stop_c].map(|values| numbers(&values));
        let [nominal_kw, nominal_energy_kwh, stop_c] = sizes;
        let law = RuleLaw::new(system.inner.clone(), rule, dt_h, nominal_kw, nominal_energy_kwh, stop_c);
        Ok(Self { inner: law.map_err(value_error)? })
    }

    /// Set-points of one step `(M,)` [kW].
    fn split(
        &self,
        py: Python<'_>,
        state: State<'_>,
        limit_kw: VectorIn<'_>,
        demand_kw: f64,
    ) -> PyResult<Vector> {
        let request_kw = state.apply(&limit_kw, |measured| self.inner.split(measured, demand_kw));
        Ok(vector(py, request_kw.map_err(value_error)?))
    }

    /// Runs the closed loop over `plant`: `demand_kw` `(T,)`, never above the sum of `limit_kw` `(T, M)`, `ambient_c` `(T,)`.
    /// Returns the record of `Plant.run`, and `request_kw`, flat in the order (step, string).
    fn run<'py>(
        &self,
        py: Python<'py>,
        plant: &mut Plant,
        demand_kw: VectorIn<'py>,
        limit_kw: MatrixIn<'py>,
        ambient_c: VectorIn<'py>,
        duration_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = self.inner.n_strings();
        check_shape("lanes of the plant", &[n], &[plant.inner.lanes()])?;
        check_shape("limit", &[demand_kw.len(), n], limit_kw.shape())?;
        check_shape("ambient_c", &[demand_kw.len()], ambient_c.shape())?;
        let demand_kw = numbers(&demand_kw);
        let split = |measured: &Measured<'_>, t: usize, _| self.inner.split(measured, demand_kw[t]);
        closed_loop(py, plant, 1, &numbers(&limit_kw), &numbers(&ambient_c), duration_s, split)
    }
}

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
        Ok(Self { inner: ExplicitLaw::new(tables).map_err(value_error)? })
    }

    #[classattr]
    const N_WEIGHTS: usize = N_WEIGHTS;

    /// Source text of the control law.
    #[classattr]
    const DECISION: &'static str = DECISION;

    /// Demand features `(N, numbers)` of each demand forecast `(N, steps)` [kW].
    fn demand_features(&self, py: Python<'_>, ahead_kw: MatrixIn<'_>) -> PyResult<Matrix> {
        let (rows, n_steps) = (ahead_kw.shape()[0], self.inner.n_steps());
        check_shape("demand", &[rows, n_steps], ahead_kw.shape())?;
        let mut features = Vec::with_capacity(rows * N_FEATURES);
        for schedule in numbers(&ahead_kw).chunks_exact(n_steps) {
            features.extend(self.inner.demand_features(schedule).map_err(value_error)?);
        }
        Ok(matrix(py, rows, features))
    }

    /// Set-points of one step `(M,)` [kW]; `ahead_kw` `(steps,)` begins with the demand of this step.
    fn split(
        &self,
        py: Python<'_>,
        weights: VectorIn<'_>,
        state: State<'_>,
        limit_kw: VectorIn<'_>,
        ahead_kw: VectorIn<'_>,
    ) -> PyResult<Vector> {
        let (weights, ahead_kw) = (numbers(&weights), numbers(&ahead_kw));
        let features = self.inner.demand_features(&ahead_kw).map_err(value_error)?;
        let split = |measured: &Measured<'_>| self.inner.split(&weights, measured, ahead_kw[0], &features);
        Ok(vector(py, state.apply(&limit_kw, split).map_err(value_error)?))
    }

    /// Runs the closed loop over `plant` with one set of weights for each of its scenarios `(S, weights)`.
    ///
    /// `demand_kw` `(T, S)`, never above the sum of `limit_kw` `(T, M)`; `features` `(T, S, numbers)`, `ambient_c` `(T, S)`.
    /// Returns the record of `Plant.run`, and `request_kw`, flat in the order (step, scenario, string).
    fn run<'py>(
        &self,
        py: Python<'py>,
        plant: &mut Plant,
        weights: MatrixIn<'py>,
        demand_kw: MatrixIn<'py>,
        features: CubeIn<'py>,
        limit_kw: MatrixIn<'py>,
        ambient_c: MatrixIn<'py>,
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
            self.inner.split(weights, measured, demand_kw[at], features)
        };
        closed_loop(py, plant, scenarios, &numbers(&limit_kw), &numbers(&ambient_c), duration_s, split)
    }
}

/// Runs a plant step by step, with `limit_kw` `(T, M)` and `ambient_c` `(T, S)`. `split` returns the set-points `(M,)`
/// [kW] of a step and a scenario from the state at its start, so the results do not depend on where a run is interrupted.
fn closed_loop<'py>(
    py: Python<'py>,
    plant: &mut Plant,
    scenarios: usize,
    limit_kw: &[f64],
    ambient_c: &[f64],
    duration_s: f64,
    split: impl Fn(&Measured<'_>, usize, usize) -> Result<Vec<f64>, InputError> + Sync,
) -> PyResult<Bound<'py, PyDict>> {
    let plant = &mut plant.inner;
    let n = plant.lanes() / scenarios.max(1);
    let run = || -> Result<(Option<Record>, Vec<f64>), InputError> {
        let mut record: Option<Record> = None;
        let mut requests_kw = Vec::new();
        for (t, ambient_c) in ambient_c.chunks_exact(scenarios.max(1)).enumerate() {
            let state = plant.state();
            let temperature_c = state.mean_temperature_c();
            let losses = state.ageing.iter().map(|ageing| ageing.loss());
            let (soh_capacity, soh_resistance): (Vec<f64>, Vec<f64>) =
                losses.map(|loss| (loss.soh_capacity, loss.soh_resistance)).unzip();
            for s in 0..scenarios {
                let measured = Measured {
                    soc: &state.soc[s * n..][..n],
                    temperature_c: &temperature_c[s * n..][..n],
                    soh_capacity: &soh_capacity[s * n..][..n],
                    soh_resistance: &soh_resistance[s * n..][..n],
                    limit_kw: &limit_kw[t * n..][..n],
                };
                requests_kw.extend(split(&measured, t, s)?);
            }
            let request_w: Vec<f64> =
                requests_kw[requests_kw.len() - scenarios * n..].iter().map(|p| p * W_PER_KW).collect();
            let step = plant.run(&request_w, None, ambient_c, duration_s, false)?;
            match &mut record {
                Some(record) => record.append(step),
                None => record = Some(step),
            }
        }
        Ok((record, requests_kw))
    };
    let (record, request_kw) = py.detach(run).map_err(value_error)?;
    let record = record.ok_or_else(|| PyValueError::new_err("demand: needs at least one step"))?;
    let out = to_dict(py, record)?;
    out.set_item("request_kw", vector(py, request_kw))?;
    Ok(out)
}
