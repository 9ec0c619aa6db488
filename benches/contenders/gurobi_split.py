"""The power split of MODEL section 3 as a nonconvex mixed-integer program, given to Gurobi.

The same equations, tables and objective, for states where nothing has to be shed (availability loss 0). The
wheel's size-limited licence allows 200 variables with quadratic constraints: two strings, five steps.
"""

from __future__ import annotations

import time

import gurobipy as gp
import numpy as np

import bess


def split(
    system: bess.System,
    state: bess.State,
    demand_kw: np.ndarray,
    weights: tuple[float, float, float],
    *,
    gap: float = 1e-3,
    dt_h: float = 0.25,
    time_limit_s: float = 60.0,
) -> tuple[np.ndarray, float, float]:
    """Return Gurobi's requests (n_strings, n_steps) [kW, signed], its objective, and the time of
    ``optimize`` [s]."""
    n_strings, n_steps = system.n_strings, len(demand_kw)
    with gp.Env(params={"OutputFlag": 0}) as env, gp.Model(env=env) as model:
        model.Params.NonConvex = 2
        model.Params.MIPGap = gap
        model.Params.TimeLimit = time_limit_s
        requests = model.addVars(n_strings, n_steps, lb=0.0, name="u")
        objective = gp.LinExpr()
        for m, string in enumerate(system.strings):
            soc, tau = float(state.soc[m]), float(state.temperature_c[m])
            for t, demand in enumerate(demand_kw):
                cost, soc, tau = _step(
                    model, string, requests[m, t], soc, tau, demand > 0.0, system.ambient_c, dt_h, weights
                )
                objective += cost / (n_strings * n_steps)
        for t, demand in enumerate(demand_kw):
            model.addConstr(requests.sum("*", t) == abs(demand))
        model.setObjective(objective)
        model.update()
        started = time.perf_counter()
        model.optimize()
        elapsed = time.perf_counter() - started
        if model.SolCount == 0:
            raise RuntimeError(f"Gurobi found no split (status {model.Status})")
        values = np.array([[requests[m, t].X for t in range(n_steps)] for m in range(n_strings)])
        return values * np.sign(demand_kw), float(model.ObjVal), elapsed


def _step(model, string, request, soc, tau, discharge, ambient_c, dt_h, weights):  # type: ignore[no-untyped-def]
    """Add one string and interval; current in 100 A, voltage in 100 V, so that V I is in 10 kW."""
    battery, inverter, derating = string.battery, string.inverter, string.derating
    nominal = inverter.nominal_kw
    ocv = np.array(battery.ocv_v.discharge[0] if discharge else battery.ocv_v.charge[0])
    loss = np.array(inverter.loss_discharge if discharge else inverter.loss_charge) * nominal
    ohm = battery.resistance_temperature
    scale = 1e-3 * battery.r_scale * battery.cells_series / battery.cells_parallel

    request.UB = nominal
    on = model.addVar(vtype=gp.GRB.BINARY)
    p, w = model.addVar(ub=nominal), model.addVar(ub=nominal)
    over = model.addVar(ub=nominal)
    current, h = model.addVar(ub=4.0), model.addVar(ub=nominal)
    drop = model.addVar(ub=10.0)
    v = _table(model, soc, battery.ocv_v.soc, ocv * battery.cells_series / 100.0)
    r = _table(model, tau, ohm.temperature_c, np.array(ohm.resistance_mohm) * scale)
    k = _table(model, tau, derating.temperature_c, np.array(derating.factor))

    model.addConstr(p == k * request)
    model.addConstr(p <= nominal * on)
    model.addGenConstrPWL(p, over, list(np.array(inverter.load) * nominal), list(loss - loss[0]))
    model.addConstr(w == over + loss[0] * on)
    model.addConstr(drop == r * current)  # 100 V
    model.addConstr(h == 10.0 * drop * current)
    model.addConstr(10.0 * v * current == (p + w + h if discharge else p - w - h))

    seconds = dt_h * 3600.0
    lumped = string.thermal.lumped
    next_soc = model.addVar(lb=battery.low_soc_switch, ub=battery.soc_max)
    next_tau = model.addVar(lb=-20.0, ub=80.0)
    sign = 1.0 if discharge else -1.0
    capacity = battery.cell_capacity_ah * battery.cells_parallel
    model.addConstr(next_soc == soc - sign * 100.0 * dt_h / capacity * current)
    model.addConstr(
        next_tau == tau + seconds * (lumped.k1_k_per_j * 1e3 * h - lumped.k2_per_s * (tau - ambient_c))
    )
    cell_v = np.interp(0.5, battery.ocv_v.soc, battery.ocv_v.discharge[0]) * battery.cells_series
    heat = np.interp(25.0, ohm.temperature_c, ohm.resistance_mohm) * scale * (nominal / cell_v) ** 2 * 1e3
    cost = (
        weights[0] / nominal * (request - p)
        + weights[1] / (inverter.loss_charge[-1] * nominal) * w
        + weights[2] / heat * h
    )
    return cost, next_soc, next_tau


def _table(model, x, knots, values):  # type: ignore[no-untyped-def]
    """A table's value at a variable, or at a number."""
    if isinstance(x, float):
        return float(np.interp(x, knots, values))
    y = model.addVar(lb=float(np.min(values)), ub=float(np.max(values)))
    model.addGenConstrPWL(
        x, y, [knots[0] - 100.0, *knots, knots[-1] + 100.0], [values[0], *values, values[-1]]
    )
    return y
