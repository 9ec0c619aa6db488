use bess_control::{ExplicitLaw, Measured, Tables, N_OUTLOOK, N_WEIGHTS};
use bess_plant::{PlantState, Record};
use bess_tables::units::W_PER_KW;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{check_shape, flat, matrix, refused, vector, Matrix, Vector};
use crate::plant::{plant_refused, to_dict, Plant};

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
        Ok(Self { inner: ExplicitLaw::new(tables).map_err(PyValueError::new_err)? })
    }

    /// Weights of a law.
    #[classattr]
    const N_WEIGHTS: usize = N_WEIGHTS;

    /// Outlook of each schedule of demand `(N, steps)` [kW], `(N, numbers)`.
    fn look(&self, py: Python<'_>, ahead_kw: PyReadonlyArray2<'_, f64>) -> PyResult<Matrix> {
        let view = ahead_kw.as_array();
        let rows = view.nrows();
        check_shape("demand", &[rows, self.inner.n_steps()], view.shape())?;
        let ahead_kw = flat(view, 1.0);
        let mut outlook = Vec::with_capacity(rows * N_OUTLOOK);
        for schedule in ahead_kw.chunks_exact(self.inner.n_steps()) {
            outlook.extend(self.inner.look(schedule).map_err(refused)?);
        }
        Ok(matrix(py, rows, outlook))
    }

    /// Set-points of one step `(M,)` [kW]; `ahead_kw` `(steps,)` begins with its demand.
    #[allow(clippy::too_many_arguments)]
    fn split(
        &self,
        py: Python<'_>,
        weights: PyReadonlyArray1<'_, f64>,
        soc: PyReadonlyArray1<'_, f64>,
        temperature_c: PyReadonlyArray1<'_, f64>,
        soh_capacity: PyReadonlyArray1<'_, f64>,
        soh_resistance: PyReadonlyArray1<'_, f64>,
        limit_kw: PyReadonlyArray1<'_, f64>,
        ahead_kw: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Vector> {
        let values = |array: &PyReadonlyArray1<'_, f64>| flat(array.as_array(), 1.0);
        let (soc, temperature_c) = (values(&soc), values(&temperature_c));
        let (soh_capacity, soh_resistance) = (values(&soh_capacity), values(&soh_resistance));
        let (limit_kw, ahead_kw) = (values(&limit_kw), values(&ahead_kw));
        let outlook = self.inner.look(&ahead_kw).map_err(refused)?;
        let plant = Measured {
            soc: &soc,
            temperature_c: &temperature_c,
            soh_capacity: &soh_capacity,
            soh_resistance: &soh_resistance,
            limit_kw: &limit_kw,
        };
        let mut request_kw = vec![0.0; self.inner.n_strings()];
        self.inner
            .split(&values(&weights), &plant, ahead_kw[0], &outlook, &mut request_kw)
            .map_err(refused)?;
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
        weights: PyReadonlyArray2<'py, f64>,
        demand_kw: PyReadonlyArray2<'py, f64>,
        outlook: PyReadonlyArray3<'py, f64>,
        limit_kw: PyReadonlyArray2<'py, f64>,
        ambient_c: PyReadonlyArray2<'py, f64>,
        duration_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = self.inner.n_strings();
        let lanes = plant.inner.lanes();
        let (steps, scenarios) = demand_kw.as_array().dim();
        check_shape("lanes of the plant", &[scenarios * n], &[lanes])?;
        check_shape("weights", &[scenarios, N_WEIGHTS], weights.as_array().shape())?;
        check_shape("outlook", &[steps, scenarios, N_OUTLOOK], outlook.as_array().shape())?;
        check_shape("limit", &[steps, n], limit_kw.as_array().shape())?;
        check_shape("ambient_c", &[steps, scenarios], ambient_c.as_array().shape())?;
        let (weights, demand_kw) = (flat(weights.as_array(), 1.0), flat(demand_kw.as_array(), 1.0));
        let (outlook, limit_kw) = (flat(outlook.as_array(), 1.0), flat(limit_kw.as_array(), 1.0));
        let ambient_c = flat(ambient_c.as_array(), 1.0);
        let cooled = plant.inner.is_cooled();
        let (law, plant) = (&self.inner, &mut plant.inner);
        let run = || -> PyResult<(Option<Record>, Vec<f64>)> {
            let mut record: Option<Record> = None;
            let mut requests_kw = Vec::with_capacity(steps * lanes);
            for t in 0..steps {
                // As a controller step by step measures it, so that it makes no difference where a run is interrupted.
                let state = plant.state();
                let temperature_c = mean_temperatures_c(&state, plant.max_nodes());
                let losses: Vec<_> = state.ageing.iter().map(|ageing| ageing.loss()).collect();
                let capacity: Vec<f64> = losses.iter().map(|loss| loss.soh_capacity).collect();
                let resistance: Vec<f64> = losses.iter().map(|loss| loss.soh_resistance).collect();
                let first = requests_kw.len();
                requests_kw.resize(first + lanes, 0.0);
                for s in (0..scenarios).filter(|s| demand_kw[t * scenarios + s] != 0.0) {
                    let at = t * scenarios + s;
                    let own = s * n..(s + 1) * n;
                    let measured = Measured {
                        soc: &state.soc[own.clone()],
                        temperature_c: &temperature_c[own.clone()],
                        soh_capacity: &capacity[own.clone()],
                        soh_resistance: &resistance[own.clone()],
                        limit_kw: &limit_kw[t * n..(t + 1) * n],
                    };
                    let seen = outlook[at * N_OUTLOOK..][..N_OUTLOOK].try_into().expect("its length");
                    let request_kw = &mut requests_kw[first + own.start..first + own.end];
                    law.split(
                        &weights[s * N_WEIGHTS..][..N_WEIGHTS],
                        &measured,
                        demand_kw[at],
                        seen,
                        request_kw,
                    )
                    .map_err(refused)?;
                }
                let request_w: Vec<f64> = requests_kw[first..].iter().map(|p| p * W_PER_KW).collect();
                let air_c = &ambient_c[t * scenarios..(t + 1) * scenarios];
                let step = plant.run(&request_w, air_c, duration_s, false).map_err(plant_refused)?;
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

/// Mean temperature of each lane [degC]; a string with fewer nodes than others has NaN beyond its own.
fn mean_temperatures_c(state: &PlantState, nodes: usize) -> Vec<f64> {
    let mean = |own: &[f64]| {
        let real = own.iter().filter(|t| !t.is_nan());
        real.clone().sum::<f64>() / real.count() as f64
    };
    state.node_temperature_c.chunks_exact(nodes).map(mean).collect()
}
