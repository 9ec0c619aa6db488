"""The same plans as a nonlinear program in CasADi for Bonmin: ``bonmin_dispatch.py PLANS MINUTES``.

The program is that of arXiv 2506.17059 as stated there: charge and discharge apart, in power and in current,
the analytic open-circuit voltage at the end of each step, resistance 0.819 mOhm a cell, voltages of 2.7 to
4.15 V a cell, currents within 2C, a converter of constant efficiency, no power in the last step.
"""

from __future__ import annotations

import json
import sys
import time

import casadi as ca
import numpy as np
from market_day import CYCLES, ENERGY_KWH, STEPS, earned_eur, prices, state

POWER_KW, SERIES, PARALLEL, CELL_AH, CELL_OHM = 180.0, 260, 2, 94.0, 0.819e-3
MIN_V, MAX_V, MAX_C, EFFICIENCY, COULOMB = 2.7, 4.15, 2.0, 0.973, 0.9999
QUIET = {f"{log}_log_level": 0 for log in ("bb", "nlp", "fp", "milp")}


def open_circuit_v(soc: ca.MX) -> ca.MX:
    """The analytic curve of one cell [V]."""
    return (
        4.5868
        + 3.1768 / (1.0 + ca.exp(3.3479 * (soc - 0.6350)))
        - 3.8418 / (1.0 + ca.exp(-6.7241 * (soc - 1.4376)))
        - 4.6932 / (1.0 + ca.exp(2.5958 * (soc - 1.0)))
        + 0.3618 / (1.0 + ca.exp(-61.9684 * soc))
        + 0.9949 * soc
    )


def planner(steps: int, dt_h: float) -> ca.Function:
    """Compile the program once; parameters are SOC and prices [EUR/MWh]. Powers are W, as there."""
    columns = [ca.MX.sym(name, steps) for name in ("c", "d", "i_c", "i_d", "v", "soc")]
    charge, discharge, charge_a, discharge_a, voltage, soc = columns
    start, price = ca.MX.sym("start"), ca.MX.sym("price", steps)
    current, before = charge_a - discharge_a, ca.vertcat(start, soc[:-1])
    moved = COULOMB * charge_a - discharge_a / COULOMB
    dc_w = voltage * current
    equal = [
        voltage - SERIES * (open_circuit_v(soc) + CELL_OHM / PARALLEL * current),
        soc - before - moved * dt_h / (CELL_AH * PARALLEL),
        dc_w - (EFFICIENCY * charge - discharge / EFFICIENCY),
        dc_w[-1],
    ]
    used = ca.sum1(charge + discharge) * dt_h / 2.0 / (1000.0 * ENERGY_KWH)
    program = {
        "x": ca.vertcat(*columns),
        "p": ca.vertcat(start, price),
        "f": ca.dot(price, charge - discharge) * dt_h,
        "g": ca.vertcat(*equal, used),
    }
    options = {"print_time": False, "bonmin": {"print_level": 0, **QUIET}}
    return ca.nlpsol("bonmin", "bonmin", program, options)


def main(plans: int, minutes: int) -> None:
    """Print the CPU of a plan [s], what all plans earn in the plant [EUR], and how many Bonmin solved."""
    dt_h, steps = minutes / 60.0, STEPS * 15 // minutes
    solver = planner(steps, dt_h)
    max_a = np.full(2 * steps, MAX_C * CELL_AH * PARALLEL)
    upper = [np.full(2 * steps, 1000.0 * POWER_KW), max_a, np.full(steps, MAX_V * SERIES), np.ones(steps)]
    cpu_s, earned, solved = 0.0, 0.0, 0
    for seed in range(plans):
        soc = float(state(seed).soc[0])
        price = np.repeat(prices(seed), steps // STEPS)
        started = time.process_time()
        answer = solver(
            x0=0.0,  # as there, for the first plan
            p=np.r_[soc, price],
            lbx=np.r_[np.zeros(4 * steps), np.full(steps, MIN_V * SERIES), np.zeros(steps)],
            ubx=np.concatenate(upper),
            lbg=np.zeros(3 * steps + 2),
            ubg=np.r_[np.zeros(3 * steps + 1), CYCLES],
        )
        cpu_s += time.process_time() - started
        solved += bool(solver.stats()["success"])
        x = np.array(answer["x"]).ravel()
        demand_kw = np.clip((x[steps : 2 * steps] - x[:steps]) / 1000.0, -POWER_KW, POWER_KW)
        earned += earned_eur(demand_kw, dt_h, seed)
    print("RESULT " + json.dumps({"plan_cpu_s": cpu_s / plans, "earned_eur": earned, "solved": solved}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
