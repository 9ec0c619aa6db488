"""Nodes of the relaxation: none may cut away a schedule that agrees with what it settles."""

import numpy as np
import pytest

import bess
from bess import _core
from bess.split.objectives import Costs
from bess.split.problem import SplitProblem
from bess.split.relaxation.data import PlantConstants
from bess.split.relaxation.group import RelaxedOver, relaxed_group
from bess.split.relaxation.nodes import RelaxedGroup

N_STRINGS, N_STEPS, DT_H = 3, 3, 0.25
COST = np.full((1, N_STRINGS, 4), 1e-2)
"""All four losses count the same [1/kW]."""
RUNNING = [
    [[0, 1, 1], [1, 0, 0], [1, 1, 1]],
    [[1, 1, 0], [1, 0, 1], [1, 1, 0]],
    [[1, 1, 1], [1, 1, 1], [1, 1, 1]],
    [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
]
"""Strings that run in each step; in the first of these alone like strings start out of order."""


def relaxed(problem: SplitProblem) -> tuple[_core.ControlHorizon, RelaxedGroup]:
    """The relaxation of the sum of all losses over everything that can be reached."""
    horizon = problem.control(Costs(COST, COST), np.zeros(1), np.zeros(1))
    boxes = horizon.reachable()
    along = _core.StateBoxes(boxes.soc_low, boxes.soc_low, boxes.temperature_low_c, boxes.temperature_low_c)
    over = RelaxedOver(boxes, np.zeros((N_STRINGS, N_STEPS), dtype=bool), boxes, along)
    constants = PlantConstants.of(problem.system, DT_H)
    return horizon, relaxed_group(
        problem, horizon, constants, COST, [], over, lambda: np.inf, lambda request_pu, on: None
    )


@pytest.mark.parametrize("running", RUNNING)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_node_that_settles_which_strings_run_is_no_dearer_than_the_schedule_that_runs_them(running, sign):
    running = np.array(running, dtype=np.int8)
    system = bess.System.reference(N_STRINGS)
    demand = sign * 60.0 * running.sum(axis=0)
    # All of one state, so that strings are like each other.
    state = bess.State(np.full(N_STRINGS, 0.5), np.full(N_STRINGS, 30.0))
    problem = SplitProblem.check(system, N_STEPS, DT_H, state, demand, None, None)
    horizon, group = relaxed(problem)
    cost = horizon.evaluate((sign * 60.0 * running)[None])[0, 0]
    settled = np.concatenate([running.ravel(), np.zeros(running.size, dtype=np.int8)])
    node = group.solve(settled, settled)
    in_order = np.all(np.diff(running[:, 0]) <= 0)
    if in_order:
        assert 0.5 * cost < node.bound <= cost
    else:
        # Another order of the like strings stands for it.
        assert node.bound == np.inf
