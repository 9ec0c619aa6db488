"""Claims about the relaxation of a whole horizon, solved to its end without any schedule that is known.

A bound that is cut off at the best schedule known can never be seen to be above it; here it is not cut off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bess
from bess import _core
from bess.control.problem import SplitProblem
from bess.control.split import tree
from bess.control.split.normalisation import constant_scale
from bess.control.split.relaxation.data import PlantConstants
from bess.control.split.relaxation.group import RelaxedGroup

NODES = 400


def objective_and_bounds(
    state: bess.State, demand_kw: list[float], limit_kw: Any = None, goals: bess.Objectives | None = None
) -> tuple[float, float, float]:
    """Objective of the best schedule found, and the bounds with coefficients over all reachable states and
    with those along that schedule."""
    system, goals = bess.System.reference(state.n_strings), goals or bess.Objectives.energy()
    problem = SplitProblem.check(system, len(demand_kw), 0.25, state, demand_kw, None, limit_kw)
    costs = goals.costs(constant_scale(system, len(demand_kw), 0.25, goals))
    control = problem.control(costs, *goals.tolerances)
    answer = control.split(None, 2000)
    soc, temperature_c = (
        np.concatenate([start[:, None], along], axis=1)
        for start, along in (
            (state.soc, answer.flows.soc),
            (state.temperature_c, answer.flows.temperature_c),
        )
    )
    schedule = _core.StateBoxes(soc, soc, temperature_c, temperature_c)
    bounds = []
    for frozen in (False, True):
        relaxed = RelaxedGroup(
            problem,
            control,
            PlantConstants.of(system, 0.25),
            costs.reported,
            [],
            np.inf,
            schedule,
            lambda request_pu, on: None,
            frozen=frozen,
        )
        root = relaxed.solve(control.root(control.reachable()))
        limit = 1 if frozen else NODES
        found = tree.search(root, lambda r=relaxed: r.nodes, lambda: np.inf, gap=1e-6, node_limit=limit)
        bounds.append(found.bound)
    return float(answer.incumbent.objectives[0]), bounds[0], bounds[1]


# Strings like each other come in an order: most of these break it, each in its own way.
CASES = {
    "the first is empty": (bess.State([0.0, 0.5], [30.0, 30.0]), [40.0, 40.0], None),
    "the first is too hot": (bess.State([0.5, 0.5], [59.9, 30.0]), [40.0, 40.0], None),
    "the first is out of service": (bess.State([0.5, 0.5], [30.0, 30.0]), [40.0, 40.0], [0.0, 92.0]),
    "the first may give little": (bess.State([0.5, 0.5], [30.0, 30.0]), [60.0, 60.0], [1.0, 92.0]),
    "the first is aged": (
        bess.State([0.5, 0.5], [30.0, 30.0], [0.8, 1.0], [3.0, 1.0]), [80.0, 80.0], None,
    ),
    "they take turns": (bess.State([0.045, 0.045], [30.0, 30.0]), [40.0, 40.0], None),
    "they are nearly full": (bess.State([0.963, 0.963], [30.0, 30.0]), [-40.0, -40.0], None),
    "both are short and one is aged": (
        bess.State([0.05, 0.05], [30.0, 30.0], [0.5, 1.0], [1.0, 1.0]), [80.0, 60.0], None,
    ),
    "one alone that is aged": (bess.State([0.1], [30.0], [0.5], [1.0]), [60.0, 60.0], None),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_no_bound_is_above_the_objective_of_a_schedule_and_none_is_far_below(name: str) -> None:
    objective, rigorous, convexified = objective_and_bounds(*CASES[name])
    assert 0.99 * objective <= rigorous <= objective
    assert 0.99 * objective <= convexified <= objective
