//! Dispatch over prices, one horizon in one call.

use bess_control::{DispatchBlock, DispatchProblem, StoreGrid, StoreState};
use bess_tables::{Axis, Lut};
use numpy::{PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{check_shape, numbers, value_error, vector, watts, CubeIn, MatrixIn, Vector, VectorIn};
use crate::model::ControlModel;

/// The plant as aggregate storage on a grid of states.
#[pyclass(module = "bess._core")]
pub struct Store {
    inner: bess_control::Store,
}

#[pymethods]
impl Store {
    /// Grid points of energy `(E,)` [kWh], temperature `(K,)` [degC] and depth `(D,)`; SOC of the strings at each energy
    /// `(E, M)`; signed powers `(P,)` [kW] and their allocation `(P, M)` [kW]; of each string its energy over SOC (two arrays),
    /// and its share in the mean temperature and standby [kW] `(M,)`.
    #[new]
    #[pyo3(signature = (model, *, energy_kwh, temperature_c, depth, soc, power_kw, request_kw, energies, mass_share, off_kw,
                        capacity_kwh, dt_h, parts, ambient_c, cooling_per_h, by_throughput))]
    fn new(
        model: &ControlModel,
        energy_kwh: VectorIn<'_>,
        temperature_c: VectorIn<'_>,
        depth: VectorIn<'_>,
        soc: MatrixIn<'_>,
        power_kw: VectorIn<'_>,
        request_kw: MatrixIn<'_>,
        energies: Vec<(Vec<f64>, Vec<f64>)>,
        mass_share: VectorIn<'_>,
        off_kw: VectorIn<'_>,
        capacity_kwh: f64,
        dt_h: f64,
        parts: usize,
        ambient_c: f64,
        cooling_per_h: f64,
        by_throughput: bool,
    ) -> PyResult<Self> {
        let table = |(soc, energy_kwh)| Lut::new("energies", soc, energy_kwh).map_err(value_error);
        let axis = |name, points| Axis::new(name, numbers(points)).map_err(value_error);
        let grid = StoreGrid {
            energy_kwh: axis("energy", &energy_kwh)?,
            temperature_c: axis("temperature", &temperature_c)?,
            depth: axis("depth", &depth)?,
            soc: numbers(&soc),
            power_kw: numbers(&power_kw),
            request_w: watts(&request_kw),
            energies: energies.into_iter().map(table).collect::<PyResult<_>>()?,
            mass_share: numbers(&mass_share),
            off_kw: numbers(&off_kw),
            capacity_kwh,
            dt_h,
            parts,
            ambient_c,
            cooling_per_h,
            by_throughput,
        };
        Ok(Self { inner: bess_control::Store::new(model.inner.clone(), grid).map_err(value_error)? })
    }

    /// Best power of each block `(B,)` [kW], signed, from `state`: energy [kWh], temperature [degC], depth.
    ///
    /// `steps`, `period` of the cycle limit, `ambient_c` and whether a new price begins `(B,)`; `income_eur` `(B, L + 1, 4)`
    /// of a kWh discharged, charged, lost by derating, and held for an hour, at each price level and at the expected price;
    /// `share` `(B, L)` and `chance` `(L, L)` of the levels; `wear` cost [EUR] over depth; `allowed_kwh` of each period, and
    /// shadow prices of cycling [EUR/kWh] where it binds.
    #[pyo3(signature = (state, *, steps, period, ambient_c, is_new, income_eur, share, chance, wear, end_eur_kwh, allowed_kwh,
                        shadow_prices_eur_kwh))]
    fn dispatch(
        &mut self,
        py: Python<'_>,
        state: (f64, f64, f64),
        steps: PyReadonlyArray1<'_, i64>,
        period: PyReadonlyArray1<'_, i64>,
        ambient_c: VectorIn<'_>,
        is_new: PyReadonlyArray1<'_, bool>,
        income_eur: CubeIn<'_>,
        share: MatrixIn<'_>,
        chance: MatrixIn<'_>,
        wear: (Vec<f64>, Vec<f64>),
        end_eur_kwh: f64,
        allowed_kwh: VectorIn<'_>,
        shadow_prices_eur_kwh: VectorIn<'_>,
    ) -> PyResult<Vector> {
        let (blocks, levels) = (steps.len(), chance.shape()[0]);
        for (name, array) in
            [("period", period.shape()), ("ambient_c", ambient_c.shape()), ("new", is_new.shape())]
        {
            check_shape(name, &[blocks], array)?;
        }
        check_shape("income", &[blocks, levels + 1, 4], income_eur.shape())?;
        check_shape("share", &[blocks, levels], share.shape())?;
        check_shape("chance", &[levels, levels], chance.shape())?;
        let (steps, period, is_new) = (steps.as_array(), period.as_array(), is_new.as_array());
        let block = |(b, ambient_c): (usize, f64)| -> PyResult<DispatchBlock> {
            let (steps, period) = (usize::try_from(steps[b])?, usize::try_from(period[b])?);
            Ok(DispatchBlock { steps, period, ambient_c, is_new: is_new[b] })
        };
        let problem = DispatchProblem {
            blocks: numbers(&ambient_c).into_iter().enumerate().map(block).collect::<PyResult<_>>()?,
            income_eur: numbers(&income_eur).chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect(),
            share: numbers(&share),
            chance: numbers(&chance),
            wear_eur: Lut::new("wear", wear.0, wear.1).map_err(value_error)?,
            end_eur_kwh,
            allowed_kwh: numbers(&allowed_kwh),
            shadow_prices_eur_kwh: numbers(&shadow_prices_eur_kwh),
            start: StoreState { energy_kwh: state.0, temperature_c: state.1, depth: state.2 },
        };
        let power_kw = py.detach(|| self.inner.dispatch(&problem)).map_err(value_error)?;
        Ok(vector(py, power_kw))
    }
}
