"""A single plan for a known demand, with lower bounds."""

from __future__ import annotations

from numpy.typing import ArrayLike

from bess.control.objectives import Objectives
from bess.control.planning.planner import Plan, Planner
from bess.control.planning.prices import PlanPrices
from bess.control.problem import demand_of_steps
from bess.errors import InputError
from bess.system import State, System

ROLLOUTS = 6000
"""Roll-outs for the best starting point of a plan."""
PRICE_PASSES = 40
"""Iterations of the shadow prices; the search gap at rated demand is then 1 to 2 %."""
PROOF_CELLS = 320
"""SOC cells of the proven bound; 320 cells take 4 CPU s for a day of identical strings. At rated demand the
proven gap is 2 to 3 %, and 3 to 5 % with the default price of starts."""


def planner_of_known_demand(
    system: System,
    n_steps: int,
    dt_h: float,
    price_passes: int = PRICE_PASSES,
    proof_cells: int | None = PROOF_CELLS,
) -> Planner:
    """Return a planner for one plan of a demand that is known; parameters as for :class:`Planner`."""
    return Planner(
        system,
        n_steps,
        dt_h,
        rollouts=ROLLOUTS,
        balance=0.0,
        price_passes=price_passes,
        proof_cells=proof_cells,
        first_step_weight=1.0,
    )


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
    """Plan the power of every string for a known demand, without a warm start.

    The plan is the cheapest of three kinds of schedules, each improved by a local search: the rules, the
    dynamic program of string pairs, and single strings at shadow prices (docs/foresight.md). Energy stored at
    the end has no value.

    Parameters
    ----------
    system : System
        1 to 1,000 strings, which may differ.
    state : State
        Measured state of every string.
    demand_kw : array_like, shape (n_steps,)
        Demand on the plant [kW], positive = discharge; 1 to 2,880 steps. Times of pandas and xarray data
        must be ``dt_h`` apart.
    objectives : Objectives, optional
        Of kind ``energy``, the default.
    dt_h : float
        Length of a step [h].
    ambient_c : float or array_like, shape (n_steps,), optional
        Ambient temperature [degC]; the system's by default.
    limit_kw : array_like, shape (n_strings,) or (n_strings, n_steps), optional
        Maximum power of each inverter, over the whole plan or in each step [kW]; 0 takes a string out of
        service.

    Returns
    -------
    Plan
        ``cost`` is in kWh: ``shortfall`` x undelivered energy + losses + ``start_kwh`` x starts, in the
        control model with the coefficients of the middle of each step.

    Raises
    ------
    InputError
        An argument does not fit the system, or the objectives are not of kind ``energy``.
    """
    goals = Objectives.energy() if objectives is None else objectives
    if not isinstance(goals, Objectives):
        raise InputError(f"objectives must be bess.Objectives, not {type(goals).__name__}")
    if goals.kind != "energy" or len(goals.groups) > 1:
        raise InputError(
            f'objectives of kind "{goals.kind}" with {len(goals.groups)} priorities: plan_power minimises '
            "one sum in kWh; use bess.Objectives.energy(), or bess.split_power for priorities"
        )
    n_steps = demand_of_steps(demand_kw).size
    planner = planner_of_known_demand(system, n_steps, dt_h)
    prices = PlanPrices.energy(goals.for_inverters(system.nominal_kw), system.n_strings, n_steps)
    return planner(state, demand_kw, prices, ambient_c=ambient_c, limit_kw=limit_kw)
