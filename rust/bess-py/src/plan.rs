use bess_control::{Interval, Losses, PlanEffort, PlanProblem, Prices};
use bess_tables::units::W_PER_KW;
use bess_tables::Direction;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{check_shape, flat, matrix, refused, Matrix};
use crate::model::ControlModel;

/// A plan and what it is worth in the control model.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct Plan {
    /// Requests `(M, T)` [kW, signed].
    request_kw: Matrix,
    /// Cost of the plan.
    cost: f64,
    /// Cost of the cheapest rule's schedule.
    rule_cost: f64,
    /// Roll-outs made.
    rollouts: usize,
    /// What one more Ah at the start would add to the cost, mean over the strings by capacity.
    start_charge: f64,
}

/// Plans over `demand_kw` `(T,)`. `loss_prices` `(T, 4)` [cost/kWh]: availability, derating, inverter, battery;
/// `wear` `(M,)` and `end_charge` [cost/Ah], `start_cost` of an inverter, `balance` [cost per Ah and hour];
/// `previous_kw` `(M, T)` is a plan to start from; `reactive_kvar` `(T,)` is what the inverters carry beside it.
#[pyfunction]
#[pyo3(signature = (model, soc, temperature_c, running, demand_kw, ambient_c, dt_h, limit_kw, loss_prices, wear,
                    start_cost, balance, end_charge, previous_kw, rollouts, fresh_rollouts, turn, reactive_kvar=None))]
#[allow(clippy::too_many_arguments)]
pub fn plan(
    py: Python<'_>,
    model: &ControlModel,
    soc: PyReadonlyArray1<'_, f64>,
    temperature_c: PyReadonlyArray1<'_, f64>,
    running: PyReadonlyArray1<'_, bool>,
    demand_kw: PyReadonlyArray1<'_, f64>,
    ambient_c: PyReadonlyArray1<'_, f64>,
    dt_h: f64,
    limit_kw: PyReadonlyArray1<'_, f64>,
    loss_prices: PyReadonlyArray2<'_, f64>,
    wear: PyReadonlyArray1<'_, f64>,
    start_cost: f64,
    balance: f64,
    end_charge: f64,
    previous_kw: Option<PyReadonlyArray2<'_, f64>>,
    rollouts: usize,
    fresh_rollouts: usize,
    turn: usize,
    reactive_kvar: Option<PyReadonlyArray1<'_, f64>>,
) -> PyResult<Plan> {
    let demand_w = flat(demand_kw.as_array(), W_PER_KW);
    let (n_strings, n_steps) = (model.inner.strings().len(), demand_w.len());
    check_shape("ambient_c", &[n_steps], ambient_c.as_array().shape())?;
    check_shape("running", &[n_strings], running.as_array().shape())?;
    check_shape("loss_prices", &[n_steps, 4], loss_prices.as_array().shape())?;
    let prices = flat(loss_prices.as_array(), 1.0 / W_PER_KW);
    let losses = prices.chunks_exact(4).map(|c| Losses::from_array([c[0], c[1], c[2], c[3]])).collect();
    let previous_w = match &previous_kw {
        Some(plan) => {
            check_shape("previous", &[n_strings, n_steps], plan.as_array().shape())?;
            let magnitudes: Vec<f64> = plan.as_array().iter().map(|p| p.abs() * W_PER_KW).collect();
            if magnitudes.iter().any(|p| !p.is_finite()) {
                return Err(PyValueError::new_err("previous: a request is not finite"));
            }
            Some(magnitudes)
        }
        None => None,
    };
    let reactive_var: Option<Vec<f64>> =
        reactive_kvar.map(|values| values.as_array().iter().map(|q| q.abs() * W_PER_KW).collect());
    let ambient_c = flat(ambient_c.as_array(), 1.0);
    let running = running.as_array().to_vec();
    let interval =
        |(&demand, &ambient_c): (&f64, &f64)| Interval { direction: Direction::of(demand), ambient_c, dt_h };
    let intervals: Vec<Interval> = demand_w.iter().zip(&ambient_c).map(interval).collect();
    let magnitudes: Vec<f64> = demand_w.iter().map(|d| d.abs()).collect();
    let prices = Prices { losses, wear: flat(wear.as_array(), 1.0), start: start_cost, balance, end_charge };
    let (soc, temperature_c) = (flat(soc.as_array(), 1.0), flat(temperature_c.as_array(), 1.0));
    let limit_w = flat(limit_kw.as_array(), W_PER_KW);
    let signs: Vec<f64> = intervals.iter().map(|i| i.direction.sign() / W_PER_KW).collect();
    let plan = py
        .detach(|| {
            let start = model.inner.states(&soc, &temperature_c)?;
            let mut problem =
                PlanProblem::new(&model.inner, start, running, &magnitudes, intervals, limit_w, prices)?;
            if let Some(reactive_var) = &reactive_var {
                problem = problem.with_reactive(reactive_var)?;
            }
            Ok(problem.plan(previous_w.as_deref(), PlanEffort { rollouts, fresh_rollouts, turn }))
        })
        .map_err(refused)?;
    let signed = plan.request_w.iter().enumerate().map(|(i, power)| signs[i % n_steps] * power).collect();
    Ok(Plan {
        request_kw: matrix(py, n_strings, signed),
        cost: plan.cost,
        rule_cost: plan.rule_cost,
        rollouts: plan.rollouts,
        start_charge: plan.start_charge,
    })
}
