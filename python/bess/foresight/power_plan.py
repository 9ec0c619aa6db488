"""One plan of a demand that is known, with bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bess import _core
from bess.errors import InputError
from bess.foresight.planner import Plan, Planner
from bess.foresight.prices import PlanPrices
from bess.numbers import Array
from bess.parameters import State, System
from bess.split.objectives import Objectives
from bess.split.problem import SplitProblem

ROLLOUTS = 600
"""Roll-outs for each schedule that a plan starts from."""
BOUND_PASSES = 100
"""Passes of the bound by prices: at rated demand the search gap is then 1 to 2 %."""


@dataclass(frozen=True, eq=False)
class PowerPlan(Plan):
    """A plan of a known demand, and how far it can be from the best.

    Attributes
    ----------
    bound : float
        Lower bound of the cost of every schedule on the control model of :func:`bess.rollout`
        (docs/equations.md, 1 to 6), proven: the sum of the least costs of single steps over all states that
        can be reached.
    """

    bound: float = np.nan

    @property
    def gap(self) -> float:
        """Share of the cost by which the plan may be above the best, proven."""
        return (self.cost - self.bound) / self.cost if self.cost > 0.0 else 0.0


def plan_power(
    system: System,
    state: State,
    demand_kw: ArrayLike,
    objectives: Objectives | None = None,
    dt_h: float = 0.25,
    *,
    ambient_c: ArrayLike | None = None,
    limit_kw: ArrayLike | None = None,
) -> PowerPlan:
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
    PowerPlan
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
        system, n_steps, dt_h, rollouts=ROLLOUTS, balance=0.0, bound_passes=BOUND_PASSES, known=True
    )
    prices = PlanPrices.energy(goals, system.n_strings, n_steps)
    plan = planner(state, demand_kw, prices, ambient_c=ambient_c, limit_kw=limit_kw)
    problem = SplitProblem.check(system, n_steps, dt_h, state, demand_kw, ambient_c, limit_kw)
    return PowerPlan(**vars(plan), bound=_proven(problem, goals))


def _proven(problem: SplitProblem, goals: Objectives) -> float:
    """Sum of the least costs of single steps over the states that can be reached [kWh]."""
    n_strings, n_steps = problem.limit_kw.shape
    costs = goals.costs(np.ones((n_strings, 4)))
    control = problem.control(costs, *goals.tolerances)
    reach = control.reachable()

    def over_the_step(values: Array, least: bool) -> Array:
        """States at the start and the end of a step, the coefficients of a step lie between."""
        after = np.append(values[:, 1:], values[:, -1:], axis=1)
        return np.asarray(np.minimum(values, after) if least else np.maximum(values, after))

    boxes = _core.StateBoxes(
        over_the_step(reach.soc_low, least=True),
        over_the_step(reach.soc_high, least=False),
        over_the_step(reach.temperature_low_c, least=True),
        over_the_step(reach.temperature_high_c, least=False),
    )
    cuts = control.step_bounds(boxes, costs.reported[0], np.abs(problem.demand_kw))
    # cost + slope x shed >= phi: where a shed kW is cheaper than the slope, shedding it all costs least.
    cheapest_shed = costs.reported[0, :, 0].min()
    share = np.minimum(
        1.0, np.divide(cheapest_shed, cuts.shed_slope, out=np.ones(n_steps), where=cuts.shed_slope > 0)
    )
    return float((cuts.phi * share).sum() * problem.dt_h)
