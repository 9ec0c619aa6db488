//! The plant: its state and its record, as flat arrays by name.

use std::sync::Arc;

use bess_plant::ageing::AgeingState;
use bess_plant::cooling::KINDS;
use bess_plant::{starting_ageing, CoolingState, DeratingLaw, PlantState, Record};
use bess_tables::units::{J_PER_KWH, W_PER_KW};
use numpy::{IntoPyArray, PyReadonlyArray1};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{numbers, value_error, watts, VectorIn};
use crate::model::System;

/// Electro-thermal plant of one or more scenarios. Arrays are flat, in the order (step, scenario, string, node).
#[pyclass(module = "bess._core")]
pub struct Plant {
    pub(crate) inner: bess_plant::Plant,
    system: Arc<bess_tables::System>,
}

/// Converts a state by name. If it has no ageing state, the ageing state follows from the state of health.
fn plant_state(system: &bess_tables::System, state: &Bound<'_, PyDict>) -> PyResult<PlantState> {
    let item = |key: &'static str| state.get_item(key)?.ok_or_else(|| PyKeyError::new_err(key));
    let values = |key| -> PyResult<Vec<f64>> { Ok(numbers(&item(key)?.extract::<VectorIn<'_>>()?)) };
    Ok(PlantState {
        soc: values("soc")?,
        node_temperature_c: values("node_temperature_c")?,
        derating_integral_k: values("derating_integral_k")?,
        inverter_on: item("inverter_on")?.extract::<PyReadonlyArray1<'_, bool>>()?.as_array().to_vec(),
        ageing: if state.contains("ageing")? {
            let lanes = item("soc")?.len()?;
            let rows = values("ageing")?;
            // One row for each lane; a length that is no multiple leaves a short row, which is rejected.
            rows.chunks((rows.len() / lanes.max(1)).max(1))
                .map(AgeingState::from_numbers)
                .collect::<Result<_, _>>()
                .map_err(value_error)?
        } else {
            starting_ageing(system, &values("soh_capacity")?, &values("soh_resistance")?)
                .map_err(value_error)?
        },
        cooling: if state.contains("cooling_stages")? {
            // The cast truncates and saturates: an invalid stage becomes the nearest, or one that no plant
            // has.
            let stages = values("cooling_stages")?.into_iter().map(|stage| stage as u8).collect();
            // Two numbers for each scenario: whether the chiller may run, and the temperature of the loop.
            let coolant = values("coolant")?;
            Some(CoolingState {
                stages,
                chilling: coolant.iter().step_by(2).map(|&chilling| chilling != 0.0).collect(),
                loop_c: coolant.iter().skip(1).step_by(2).copied().collect(),
            })
        } else {
            None
        },
    })
}

/// Supported kinds of cooling.
#[pyfunction]
pub fn cooling_kinds() -> Vec<&'static str> {
    KINDS.map(|kind| kind.name).to_vec()
}

#[pymethods]
impl Plant {
    /// `derating_law` is "table" or "pi"; `state` is as returned by `Plant.state`.
    #[new]
    fn new(
        py: Python<'_>,
        system: &System,
        scenarios: usize,
        plant_step_s: f64,
        derating_law: &str,
        state: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let law = match derating_law {
            "table" => DeratingLaw::Table,
            "pi" => DeratingLaw::Pi,
            other => {
                return Err(PyValueError::new_err(format!("derating law '{other}': use 'table' or 'pi'")))
            }
        };
        let state = plant_state(&system.inner, state)?;
        let inner = py
            .detach(|| bess_plant::Plant::new(&system.inner, scenarios, plant_step_s, law, &state))
            .map_err(value_error)?;
        Ok(Self { inner, system: system.inner.clone() })
    }

    /// The whole state, as flat arrays.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = self.inner.state();
        let out = PyDict::new(py);
        out.set_item("soc", state.soc.into_pyarray(py))?;
        out.set_item("node_temperature_c", state.node_temperature_c.into_pyarray(py))?;
        out.set_item("derating_integral_k", state.derating_integral_k.into_pyarray(py))?;
        out.set_item("inverter_on", state.inverter_on.into_pyarray(py))?;
        let mut rows: Vec<Vec<f64>> = state.ageing.iter().map(AgeingState::to_numbers).collect();
        let width = rows.iter().map(Vec::len).max().unwrap_or(0);
        rows.iter_mut().for_each(|row| row.resize(width, 0.0));
        out.set_item("ageing", rows.concat().into_pyarray(py))?;
        if let Some(cooling) = state.cooling {
            let stages: Vec<f64> = cooling.stages.into_iter().map(f64::from).collect();
            out.set_item("cooling_stages", stages.into_pyarray(py))?;
            let pair = |(&chilling, &loop_c)| [f64::from(u8::from(chilling)), loop_c];
            let coolant: Vec<f64> = cooling.chilling.iter().zip(&cooling.loop_c).flat_map(pair).collect();
            out.set_item("coolant", coolant.into_pyarray(py))?;
        }
        Ok(out)
    }

    fn set_state(&mut self, state: &Bound<'_, PyDict>) -> PyResult<()> {
        self.inner.set_state(&plant_state(&self.system, state)?).map_err(value_error)
    }

    /// Simulates all requests [kW], with reactive power [kvar] if given; returns flat arrays by name, in kW,
    /// kvar, A, degC and kWh.
    #[pyo3(signature = (request_kw, ambient_c, duration_s, keep_nodes, reactive_kvar=None))]
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        request_kw: VectorIn<'py>,
        ambient_c: VectorIn<'py>,
        duration_s: f64,
        keep_nodes: bool,
        reactive_kvar: Option<VectorIn<'py>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (request_w, ambient_c) = (watts(&request_kw), numbers(&ambient_c));
        let reactive_var = reactive_kvar.map(|values| watts(&values));
        let inner = &mut self.inner;
        let record = py
            .detach(|| inner.run(&request_w, reactive_var.as_deref(), &ambient_c, duration_s, keep_nodes))
            .map_err(value_error)?;
        to_dict(py, record)
    }
}

/// A record by name, in kW, kvar, A, degC and kWh.
pub(crate) fn to_dict(py: Python<'_>, mut record: Record) -> PyResult<Bound<'_, PyDict>> {
    let out = PyDict::new(py);
    let limits: Vec<u8> = record.limits.iter().map(|limits| limits.0).collect();
    out.set_item("limits", limits.into_pyarray(py))?;
    out.set_item("node_temperature_c", std::mem::take(&mut record.node_temperature_c).into_pyarray(py))?;
    for (field, values) in record.into_flows() {
        let (name, unit) = match field.rsplit_once('_') {
            Some((flow, "w")) => (format!("{flow}_kw"), W_PER_KW),
            Some((flow, "var")) => (format!("{flow}_kvar"), W_PER_KW),
            Some((flow, "j")) => (format!("{flow}_kwh"), J_PER_KWH),
            _ => (field.to_owned(), 1.0),
        };
        let values: Vec<f64> = values.into_iter().map(|v| v / unit).collect();
        out.set_item(name, values.into_pyarray(py))?;
    }
    Ok(out)
}
