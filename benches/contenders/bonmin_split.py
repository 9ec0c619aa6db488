"""The power split of MODEL section 3 as a smooth mixed-integer program, given to Bonmin through CasADi.

The same equations and objective, for states where nothing has to be shed (availability loss 0). Bonmin wants
smooth functions, so each table becomes the cubic spline through its knots.
"""

from __future__ import annotations

import time

import casadi as ca
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
    """Return Bonmin's requests (n_strings, n_steps) [kW, signed], objective, and time of the solve [s]."""
    n_strings, n_steps = system.n_strings, len(demand_kw)
    requests = ca.MX.sym("u", n_strings, n_steps)
    on = ca.MX.sym("on", n_strings, n_steps)
    current = ca.MX.sym("I", n_strings, n_steps)
    objective: ca.MX = ca.MX(0)
    equal, below = [], []
    for m, string in enumerate(system.strings):
        battery, inverter = string.battery, string.inverter
        nominal = inverter.nominal_kw
        ohm_of = _spline("r", string.battery.resistance_temperature.temperature_c,
                         np.array(battery.resistance_temperature.resistance_mohm)
                         * 1e-3 * battery.r_scale * battery.cells_series
                         / battery.cells_parallel)  # fmt: skip
        factor_of = _spline("k", string.derating.temperature_c, np.array(string.derating.factor))
        cell_v = np.interp(0.5, battery.ocv_v.soc, battery.ocv_v.discharge[0]) * battery.cells_series
        heat_nominal = float(ohm_of(25.0)) * (nominal * 1e3 / cell_v) ** 2 / 1e3
        soc, tau = ca.MX(float(state.soc[m])), ca.MX(float(state.temperature_c[m]))
        for t, demand in enumerate(demand_kw):
            discharge = demand > 0.0
            volt_of = _spline("v", battery.ocv_v.soc,
                              np.array(battery.ocv_v.discharge[0] if discharge else battery.ocv_v.charge[0])
                              * battery.cells_series)  # fmt: skip
            table = np.array(inverter.loss_discharge if discharge else inverter.loss_charge)
            loss_of = _spline("w", inverter.load, table - table[0])
            p = factor_of(tau) * requests[m, t] if float(state.temperature_c[m]) > 40.0 else requests[m, t]
            w = nominal * (loss_of(p / nominal) + table[0] * on[m, t])
            resistance, amps = ohm_of(tau), 100.0 * current[m, t]
            h = resistance * amps**2 / 1e3
            equal.append(volt_of(soc) * amps / 1e3 - (p + w + h if discharge else p - w - h))
            below.append(p - nominal * on[m, t])
            lumped, seconds = string.thermal.lumped, dt_h * 3600.0
            capacity = battery.cell_capacity_ah * battery.cells_parallel
            soc = soc - (1.0 if discharge else -1.0) * amps * dt_h / capacity
            below += [battery.low_soc_switch - soc, soc - battery.soc_max]
            tau = tau + seconds * (lumped.k1_k_per_j * 1e3 * h - lumped.k2_per_s * (tau - system.ambient_c))
            objective += (
                weights[0] / nominal * (requests[m, t] - p)
                + weights[1] / (inverter.loss_charge[-1] * nominal) * w
                + weights[2] / heat_nominal * h
            ) / (n_strings * n_steps)
    for t, demand in enumerate(demand_kw):
        equal.append(ca.sum1(requests[:, t]) - abs(demand))
    size = n_strings * n_steps
    solver = ca.nlpsol(
        "bonmin",
        "bonmin",
        {"x": ca.veccat(requests, on, current), "f": objective, "g": ca.vertcat(*equal, *below)},
        {
            "discrete": [False] * size + [True] * size + [False] * size,
            "print_time": False,
            "bonmin": {"allowable_fraction_gap": gap, "time_limit": time_limit_s, "print_level": 0,
                       "bb_log_level": 0, "nlp_log_level": 0, "fp_log_level": 0, "milp_log_level": 0},
        },
    )  # fmt: skip
    nominal_kw = np.repeat(system.nominal_kw[None, :], n_steps, axis=0).ravel()
    started = time.perf_counter()
    answer = solver(
        x0=np.concatenate([nominal_kw / 2.0, np.ones(size), np.ones(size)]),
        lbx=np.zeros(3 * size),
        ubx=np.concatenate([nominal_kw, np.ones(size), np.full(size, 4.0)]),
        lbg=np.concatenate([np.zeros(len(equal)), np.full(len(below), -np.inf)]),
        ubg=np.zeros(len(equal) + len(below)),
    )
    elapsed = time.perf_counter() - started
    if not solver.stats()["success"]:
        raise RuntimeError(f"Bonmin found no split ({solver.stats()['return_status']})")
    values = np.array(answer["x"]).ravel()[:size].reshape((n_strings, n_steps), order="F")
    return values * np.sign(demand_kw), float(answer["f"]), elapsed


def _spline(name: str, knots: object, values: np.ndarray) -> ca.Function:
    return ca.interpolant(name, "bspline", [list(knots)], list(values))  # type: ignore[call-overload]
