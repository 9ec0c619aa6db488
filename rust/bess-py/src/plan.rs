//! A plan of a day or more, in one call.

use bess_control::{Groups, Interval, Losses, PlanEffort, PlanProblem, Prices};
use bess_tables::units::W_PER_KW;
use bess_tables::Direction;
use numpy::{PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{check_shape, matrix, numbers, scaled, value_error, watts, Matrix, MatrixIn, VectorIn};
use crate::model::ControlModel;

/// A plan and its cost in the control model.
#[pyclass(frozen, get_all, module = "bess._core")]
pub struct Plan {
    /// Requests `(M, T)` [kW, signed].
    request_kw: Matrix,
    cost: f64,
    /// Cost of the cheapest rule's schedule.
    rule_cost: f64,
    /// Dual bound on the grid; None if not computed.
    search_bound: Option<f64>,
    /// Proven lower bound by prices on the control model with the coefficients at the start of each step; None if not computed.
    bound: Option<f64>,
    rollouts: usize,
    /// Marginal cost of initial charge, mean over the strings by capacity.
    start_charge: f64,
}

/// Plans over `demand_kw` `(T,)`, from the measured state and whether each inverter is `running` `(M,)`, within the limits
/// `limit_kw` `(M, T)` of the inverters.
///
/// Prices: `loss_prices` `(T, 4)` of availability, derating, inverter and battery loss [cost/kWh]; `wear`
/// `(M,)` and `end_charge` [cost/Ah]; `start_cost` of an inverter; `balance` [cost per Ah and hour]. Effort:
/// `rollouts` for the shifted warm start `previous_kw` `(M, T)`, or for the best start of a restart; before, `restart_rollouts` for each
/// start (0: no restart); `price_passes` for the shadow prices; `proof_cells` for the proven bound (None: no bounds); `turn`
/// counts the calls. `reactive_kvar` `(T,)` is the reactive power of the plant. Strings of one number
/// in `groups` `(M,)` are planned as one; strings below 0 are out of service.
#[pyfunction]
#[pyo3(signature = (model, *, soc, temperature_c, running, demand_kw, ambient_c, dt_h, limit_kw, loss_prices, wear,
                    start_cost, balance, end_charge, previous_kw, rollouts, restart_rollouts, price_passes, proof_cells, turn, reactive_kvar=None, groups=None))]
pub fn plan(
    py: Python<'_>,
    model: &ControlModel,
    soc: VectorIn<'_>,
    temperature_c: VectorIn<'_>,
    running: PyReadonlyArray1<'_, bool>,
    demand_kw: VectorIn<'_>,
    ambient_c: VectorIn<'_>,
    dt_h: f64,
    limit_kw: MatrixIn<'_>,
    loss_prices: MatrixIn<'_>,
    wear: VectorIn<'_>,
    start_cost: f64,
    balance: f64,
    end_charge: f64,
    previous_kw: Option<MatrixIn<'_>>,
    rollouts: usize,
    restart_rollouts: usize,
    price_passes: usize,
    proof_cells: Option<usize>,
    turn: usize,
    reactive_kvar: Option<VectorIn<'_>>,
    groups: Option<PyReadonlyArray1<'_, i64>>,
) -> PyResult<Plan> {
    let (n_strings, n_steps) = (model.inner.strings().len(), demand_kw.len());
    check_shape("ambient_c", &[n_steps], ambient_c.shape())?;
    check_shape("loss_prices", &[n_steps, 4], loss_prices.shape())?;
    check_shape("limit_kw", &[n_strings, n_steps], limit_kw.shape())?;
    if let Some(plan) = &previous_kw {
        check_shape("previous", &[n_strings, n_steps], plan.shape())?;
        if plan.as_array().iter().any(|p| !p.is_finite()) {
            return Err(PyValueError::new_err("previous: a request is not finite"));
        }
    }
    let start = model.states(&soc, &temperature_c)?;
    let interval =
        |(&demand, ambient_c): (&f64, f64)| Interval { direction: Direction::of(demand), ambient_c, dt_h };
    let intervals: Vec<Interval> =
        demand_kw.as_array().iter().zip(numbers(&ambient_c)).map(interval).collect();
    let signs: Vec<f64> = intervals.iter().map(|i| i.direction.sign() / W_PER_KW).collect();
    let magnitudes = |mut powers_w: Vec<f64>| {
        powers_w.iter_mut().for_each(|p| *p = p.abs());
        powers_w
    };
    let demand_w = magnitudes(watts(&demand_kw));
    let previous_w = previous_kw.map(|plan| magnitudes(watts(&plan)));
    let reactive_var = reactive_kvar.map(|values| magnitudes(watts(&values)));
    let (running, limit_w) = (running.as_array().to_vec(), watts(&limit_kw));
    let losses = Losses::rows(&scaled(&loss_prices, 1.0 / W_PER_KW));
    let prices = Prices { losses, wear: numbers(&wear), start: start_cost, balance, end_charge };
    let group = |group: &i64| usize::try_from(*group).ok();
    let groups = groups
        .map(|groups| Groups::new(&groups.as_array().iter().map(group).collect::<Vec<_>>(), n_strings))
        .transpose()
        .map_err(value_error)?;
    let effort = PlanEffort { rollouts, restart_rollouts, price_passes, proof_cells, turn };
    let plan = py
        .detach(|| {
            let mut problem =
                PlanProblem::new(&model.inner, start, running, &demand_w, intervals, &limit_w, prices)?;
            if let Some(reactive_var) = &reactive_var {
                problem = problem.with_reactive(reactive_var)?;
            }
            match &groups {
                Some(groups) => problem.plan_in_groups(groups, previous_w.as_deref(), effort),
                None => Ok(problem.plan(previous_w.as_deref(), effort)),
            }
        })
        .map_err(|error: bess_tables::InputError| value_error(error))?;
    let signed = plan.request_w.iter().enumerate().map(|(i, power)| signs[i % n_steps] * power).collect();
    Ok(Plan {
        request_kw: matrix(py, n_strings, signed),
        cost: plan.cost,
        rule_cost: plan.rule_cost,
        search_bound: plan.search_bound,
        bound: plan.bound,
        rollouts: plan.rollouts,
        start_charge: plan.start_charge,
    })
}
