"""One plan of a demand that is known, with bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bess.errors import InputError
from bess.foresight.planner import Plan, Planner
from bess.foresight.prices import PlanPrices
from bess.parameters import State, System
from bess.split.objectives import Objectives

ROLLOUTS = 600
"""Roll-outs for each schedule that a plan starts from."""
BOUND_PASSES = 100
"""Passes of the bound by prices: at rated demand the search gap is then 1 to 2 %."""
PROOF_CELLS = 320
"""Cells of SOC in which the bound is proven, in 4 CPU s for a day of strings that are alike. At rated demand
the proven gap is then 3 to 5 % where starts are free (7 % with their price), and 7 to 10 % with half as
many."""


def plan_power(
    system: System,
    state: State,
    demand_kw: ArrayLike,
    objectives: Objectives | None = None,
    dt_h: float = 0.25,
    *,
    ambient_c: ArrayLike | None = None,
    limit_kw: ArrayLike | None = None,
) -> Plan:
    """Plan the power of every string over a demand that is known, from nothing.

    The cheapest schedule of three kinds, each polished by a local search: those of the rules, that of the
    dynamic program of pairs of strings, and that of single strings at prices (docs/foresight.md). Energy left
    at the end is worth nothing.

    Parameters
    ----------
    system : System
        1 to 32 strings, which may differ.
    state : State
        Measured state of every string.
    demand_kw : array_like, shape (n_steps,)
        Demand on the plant [kW], positive = discharge; 1 to 2,880 steps.
    objectives : Objectives, optional
        Of kind ``energy``, the default.
    dt_h : float
        Length of a step [h].
    ambient_c : float or array_like, shape (n_steps,), optional
        Ambient temperature [degC]; the system's by default.
    limit_kw : array_like, shape (n_strings,), optional
        Largest power of each inverter [kW]; 0 takes a string out of service.

    Returns
    -------
    Plan
        ``cost`` is in kWh: ``shortfall`` x undelivered energy + losses + ``start_kwh`` x starts, in the
        control model with the coefficients of the middle of each step.

    Raises
    ------
    InputError
        If something given does not fit the system, or objectives are not of kind ``energy``.
    """
    goals = Objectives.energy() if objectives is None else objectives
    if goals.kind != "energy" or len(goals.groups) > 1:
        raise InputError(
            f'objectives of kind "{goals.kind}" with {len(goals.groups)} priorities: plan_power minimises '
            "one sum in kWh; use bess.Objectives.energy(), or bess.split_power for priorities"
        )
    n_steps = np.size(demand_kw)
    planner = Planner(
        system,
        n_steps,
        dt_h,
        rollouts=ROLLOUTS,
        balance=0.0,
        bound_passes=BOUND_PASSES,
        proof_cells=PROOF_CELLS,
        known=True,
    )
    prices = PlanPrices.energy(goals, system.n_strings, n_steps)
    return planner(state, demand_kw, prices, ambient_c=ambient_c, limit_kw=limit_kw)
