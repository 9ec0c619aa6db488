//! Rules of the closed loop: single steps, and runs of the plant.

use std::sync::Arc;

use bess_control::{Measured, Rule as Kind, RuleLaw};
use bess_plant::Record;
use bess_tables::units::W_PER_KW;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{check_shape, numbers, refused, vector, GivenMatrix, GivenVector, Vector};
use crate::plant::{to_dict, Plant};
use crate::system::System;

/// Allocates `total_kw` in proportion to `weights` up to `caps_kw` `(M,)`.
#[pyfunction]
pub fn water_fill(
    py: Python<'_>,
    total_kw: f64,
    weights: GivenVector<'_>,
    caps_kw: GivenVector<'_>,
) -> PyResult<Vector> {
    check_shape("weights", caps_kw.shape(), weights.shape())?;
    Ok(vector(py, bess_control::water_fill(total_kw, &numbers(&weights), &numbers(&caps_kw))))
}

/// A rule that allocates the demand of each step.
#[pyclass(frozen, module = "bess._core")]
pub struct Rule {
    law: RuleLaw,
    system: Arc<bess_tables::System>,
    fresh: bess_control::ControlModel,
}

#[pymethods]
impl Rule {
    /// `name` is that of the policy; arrays `(M,)`: nominal power [kW] and energy [kWh], temperature of full
    /// derating [degC].
    #[new]
    fn new(
        system: &System,
        name: &str,
        dt_h: f64,
        nominal_kw: GivenVector<'_>,
        nominal_energy_kwh: GivenVector<'_>,
        stop_c: GivenVector<'_>,
    ) -> PyResult<Self> {
        let rule = match name {
            "equal" => Kind::Equal,
            "priority" => Kind::Priority,
            "soc" => Kind::Soc,
            "temperature" => Kind::Temperature,
            other => return Err(PyValueError::new_err(format!("rule '{other}' is not known"))),
        };
        let law = RuleLaw {
            rule,
            dt_h,
            nominal_kw: numbers(&nominal_kw),
            nominal_energy_kwh: numbers(&nominal_energy_kwh),
            stop_c: numbers(&stop_c),
        };
        law.check(system.inner.strings.len()).map_err(refused)?;
        let fresh = bess_control::ControlModel::new(&system.inner);
        Ok(Self { law, system: system.inner.clone(), fresh })
    }

    /// Set-points of one step `(M,)` [kW].
    #[allow(clippy::too_many_arguments)]
    fn split(
        &self,
        py: Python<'_>,
        soc: GivenVector<'_>,
        temperature_c: GivenVector<'_>,
        soh_capacity: GivenVector<'_>,
        soh_resistance: GivenVector<'_>,
        limit_kw: GivenVector<'_>,
        demand_kw: f64,
    ) -> PyResult<Vector> {
        let measured = Measured {
            soc: &numbers(&soc),
            temperature_c: &numbers(&temperature_c),
            soh_capacity: &numbers(&soh_capacity),
            soh_resistance: &numbers(&soh_resistance),
            limit_kw: &numbers(&limit_kw),
        };
        Ok(vector(py, self.request_kw(&measured, demand_kw)?))
    }

    /// Runs the closed loop over `plant`: `demand_kw` `(T,)`, never above the sum of `limit_kw` `(T, M)`,
    /// `ambient_c` `(T,)`. Returns the record of `Plant.run`, and `request_kw`, flat in the order (step,
    /// string).
    fn run<'py>(
        &self,
        py: Python<'py>,
        plant: &mut Plant,
        demand_kw: GivenVector<'py>,
        limit_kw: GivenMatrix<'py>,
        ambient_c: GivenVector<'py>,
        duration_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = self.law.nominal_kw.len();
        check_shape("lanes of the plant", &[n], &[plant.inner.lanes()])?;
        check_shape("limit", &[demand_kw.len(), n], limit_kw.shape())?;
        check_shape("ambient_c", &[demand_kw.len()], ambient_c.shape())?;
        let demand_kw = numbers(&demand_kw);
        let split = |measured: &Measured<'_>, t: usize, _| self.request_kw(measured, demand_kw[t]);
        closed_loop(py, plant, 1, &numbers(&limit_kw), &numbers(&ambient_c), duration_s, split)
    }
}

impl Rule {
    fn request_kw(&self, measured: &Measured<'_>, demand_kw: f64) -> PyResult<Vec<f64>> {
        let aged = RuleLaw::model_at(&self.system, &self.fresh, measured).map_err(refused)?;
        self.law.split(aged.as_ref().unwrap_or(&self.fresh), measured, demand_kw).map_err(refused)
    }
}

/// Runs a plant step by step, with `limit_kw` `(T, M)` and `ambient_c` `(T, S)`. `split` returns the set-points `(M,)`
/// [kW] of a step and a scenario from the state at its start, so the results do not depend on where a run is interrupted.
pub(crate) fn closed_loop<'py>(
    py: Python<'py>,
    plant: &mut Plant,
    scenarios: usize,
    limit_kw: &[f64],
    ambient_c: &[f64],
    duration_s: f64,
    split: impl Fn(&Measured<'_>, usize, usize) -> PyResult<Vec<f64>> + Sync,
) -> PyResult<Bound<'py, PyDict>> {
    let (cooled, plant) = (plant.inner.is_cooled(), &mut plant.inner);
    let n = plant.lanes() / scenarios.max(1);
    let run = || -> PyResult<(Option<Record>, Vec<f64>)> {
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
            let step = plant.run(&request_w, None, ambient_c, duration_s, false).map_err(refused)?;
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
