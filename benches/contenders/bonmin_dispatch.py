"""The same plans as a nonlinear program in CasADi for Bonmin: ``bonmin_dispatch.py PLANS MINUTES``.

The model is that of arXiv 2506.17059: resistance 0.819 mOhm a cell, a converter of constant efficiency, steps
of a minute; voltage limits are left out, as the plant has none.
"""

from __future__ import annotations

import json
import sys
import time

import casadi as ca
import numpy as np
from market_day import CYCLES, ENERGY_KWH, STEPS, SYSTEM, earned_eur, prices, state

import bess

POWER_KW, CELLS, CELL_AH, CELL_OHM = 180.0, 520, 94.0, 0.819e-3
EFFICIENCY = 0.973
QUIET = {f"{log}_log_level": 0 for log in ("bb", "nlp", "fp", "milp")}


def planner(steps: int, dt_h: float) -> ca.Function:
    """Compile the program once; parameters are SOC and prices [EUR/MWh]."""
    ocv = bess.load_system(SYSTEM).strings[0].battery.ocv_v
    # A polynomial, as smooth as the analytic curve of the publication: a spline keeps Bonmin from converging.
    grid = np.linspace(0.0, 1.0, 201)
    powers = np.polyfit(grid, np.interp(grid, ocv.soc, ocv.discharge[0]), 7)
    charge, discharge = ca.MX.sym("c", steps), ca.MX.sym("d", steps)
    current, soc = ca.MX.sym("i", steps), ca.MX.sym("soc", steps)
    start, price = ca.MX.sym("start"), ca.MX.sym("price", steps)
    before = ca.vertcat(start, soc[:-1])

    net_kw = EFFICIENCY * charge - discharge / EFFICIENCY
    voltage = ca.MX(0.0)
    for power in powers:
        voltage = voltage * before + power
    cell_w = (voltage + CELL_OHM * current) * current
    equal = [(net_kw - CELLS * cell_w / 1000.0) / POWER_KW, soc - before - current * dt_h / CELL_AH]
    used = ca.sum1(charge + discharge) * dt_h / 2.0 / ENERGY_KWH
    program = {
        "x": ca.vertcat(charge, discharge, current, soc),
        "p": ca.vertcat(start, price),
        "f": ca.dot(price, charge - discharge) * dt_h / 1000.0,
        "g": ca.vertcat(*equal, used),
    }
    options = {"print_time": False, "bonmin": {"print_level": 0, **QUIET}}
    return ca.nlpsol("bonmin", "bonmin", program, options)


def main(plans: int, minutes: int) -> None:
    """Print the CPU of a plan [s], what all plans earn in the plant [EUR], and how many Bonmin solved."""
    dt_h, steps = minutes / 60.0, STEPS * 15 // minutes
    solver = planner(steps, dt_h)
    lower = np.r_[np.zeros(2 * steps), np.full(steps, -2.0 * CELL_AH), np.zeros(steps)]
    upper = np.r_[np.full(2 * steps, POWER_KW), np.full(steps, 2.0 * CELL_AH), np.ones(steps)]
    cpu_s, earned, solved = 0.0, 0.0, 0
    for seed in range(plans):
        soc = float(state(seed).soc[0])
        price = np.repeat(prices(seed), steps // STEPS)
        started = time.process_time()
        answer = solver(
            x0=np.r_[np.zeros(3 * steps), np.full(steps, soc)],
            p=np.r_[soc, price],
            lbx=lower,
            ubx=upper,
            lbg=np.r_[np.zeros(2 * steps), 0.0],
            ubg=np.r_[np.zeros(2 * steps), CYCLES],
        )
        cpu_s += time.process_time() - started
        solved += bool(solver.stats()["success"])
        x = np.array(answer["x"]).ravel()
        demand_kw = np.clip(x[steps : 2 * steps] - x[:steps], -POWER_KW, POWER_KW)
        earned += earned_eur(demand_kw, dt_h, seed)
    print("RESULT " + json.dumps({"plan_cpu_s": cpu_s / plans, "earned_eur": earned, "solved": solved}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
