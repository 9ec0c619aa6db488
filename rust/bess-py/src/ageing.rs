//! Rates of ageing for optimisers, and the count of cycles.

use bess_plant::ageing::{models, Rainflow, StringAgeing};
use numpy::ndarray::Array2;
use numpy::IntoPyArray;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{value_error, Matrix, MatrixIn, VectorIn};
use crate::model::System;

/// Marginal rates of ageing of the strings of a plant, each by its own model.
#[pyclass(frozen, module = "bess._core")]
pub struct Ageing {
    strings: Vec<StringAgeing>,
}

impl Ageing {
    /// `rate(string, loss so far, point)` for each string's own points, all `(n_strings, n_points)`.
    fn table<'py>(
        &self,
        py: Python<'py>,
        loss: &VectorIn<'py>,
        axes: &[&MatrixIn<'py>],
        rate: impl Fn(&StringAgeing, f64, &[f64]) -> f64,
    ) -> PyResult<Matrix> {
        let loss = loss.as_array();
        let shape = (self.strings.len(), axes[0].as_array().ncols());
        if loss.len() != shape.0 || axes.iter().any(|axis| axis.as_array().dim() != shape) {
            return Err(PyValueError::new_err(format!(
                "needs one loss for each of {} strings and points of shape {shape:?}",
                shape.0
            )));
        }
        let mut point = vec![0.0; axes.len()];
        let rates = Array2::from_shape_fn(shape, |at| {
            for (value, axis) in point.iter_mut().zip(axes) {
                *value = axis.as_array()[at];
            }
            rate(&self.strings[at.0], loss[at.0], &point)
        });
        Ok(rates.into_pyarray(py).unbind())
    }
}

#[pymethods]
impl Ageing {
    #[new]
    fn new(system: &System) -> PyResult<Self> {
        let strings = system.inner.strings.iter().map(StringAgeing::new).collect::<Result<_, _>>();
        Ok(Self { strings: strings.map_err(value_error)? })
    }

    /// Capacity lost per equivalent full cycle, a share of the nameplate, `(n_strings, n_points)`: for strings
    /// with a loss of `cyclic_loss` `(n_strings,)`, at points of depth, middle SOC, C-rate and temperature.
    fn cyclic_rate<'py>(
        &self,
        py: Python<'py>,
        cyclic_loss: VectorIn<'py>,
        depth: MatrixIn<'py>,
        soc: MatrixIn<'py>,
        c_rate: MatrixIn<'py>,
        temperature_c: MatrixIn<'py>,
    ) -> PyResult<Matrix> {
        self.table(py, &cyclic_loss, &[&depth, &soc, &c_rate, &temperature_c], |string, loss, at| {
            string.cyclic_rate(loss, at[0], at[1], at[2], at[3])
        })
    }

    /// Capacity lost per day, a share of the nameplate, `(n_strings, n_points)`: for strings with a loss of
    /// `calendar_loss` `(n_strings,)`, at points of SOC and temperature.
    fn calendar_rate<'py>(
        &self,
        py: Python<'py>,
        calendar_loss: VectorIn<'py>,
        soc: MatrixIn<'py>,
        temperature_c: MatrixIn<'py>,
    ) -> PyResult<Matrix> {
        self.table(py, &calendar_loss, &[&soc, &temperature_c], |string, loss, at| {
            string.calendar_rate(loss, at[0], at[1])
        })
    }
}

/// Name and description of every ageing model.
#[pyfunction]
pub fn ageing_models() -> Vec<(&'static str, &'static str)> {
    models::MODELS.iter().map(|model| (model.name, model.about)).collect()
}

/// Cycles of a series (ASTM E1049-85, rainflow): range, mean, count (1 or 0.5), index of both ends; open ranges
/// at the end count as half cycles.
#[pyfunction]
pub fn rainflow(series: VectorIn<'_>) -> Vec<(f64, f64, f64, usize, usize)> {
    let (mut counter, mut out) = (Rainflow::default(), Vec::new());
    for (index, &value) in series.as_array().iter().enumerate() {
        counter.push(value, index, |cycle| out.push(cycle));
    }
    out.extend(counter.open());
    out.iter()
        .map(|c| {
            let (a, b) = (c.from.value, c.to.value);
            ((a - b).abs(), 0.5 * (a + b), c.count, c.from.data, c.to.data)
        })
        .collect()
}
