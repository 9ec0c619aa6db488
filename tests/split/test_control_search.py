"""The search against exhaustive search: two strings, three steps, where the control model is hard."""

from __future__ import annotations

import numpy as np
import pytest
from control_cases import Case, case
from numpy.typing import NDArray

pytestmark = pytest.mark.exhaustive

N_STEPS = 3
COARSE = 33
REFINEMENTS = 7


def exhaustive(problem: Case, ceiling: float = 0.0) -> NDArray[np.float64]:
    """Best objectives on a grid of shares of all steps, refined about its best points.

    The availability objective is minimised down to ``ceiling``, then the losses.
    """
    demand, limit = np.abs(problem.demand_kw), problem.limit_kw
    low = np.maximum(0.0, demand - limit[1])
    high = np.minimum(demand, limit[0])
    axes = [np.linspace(a, b, COARSE) for a, b in zip(low, high, strict=True)]
    first = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, N_STEPS)
    best, best_costs = _pick(problem, first, ceiling)
    width = (high - low) / (COARSE - 1)
    for _ in range(REFINEMENTS):
        offsets = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * N_STEPS, indexing="ij"), axis=-1)
        nearby = best[:, None, :] + offsets.reshape(1, -1, N_STEPS) * width
        nearby = np.clip(nearby, low, high).reshape(-1, N_STEPS)
        best, best_costs = _pick(problem, np.concatenate([best, nearby]), ceiling)
        width = width / 4.0
    return best_costs


def _pick(
    problem: Case, first: NDArray[np.float64], ceiling: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The sixteen best schedules (by the first string's requests) and the objectives of the best."""
    second = np.clip(np.abs(problem.demand_kw) - first, 0.0, problem.limit_kw[1])
    costs = problem.horizon.evaluate(np.stack([first, second], axis=1) * problem.sign)
    order = np.lexsort((costs[:, 1], np.maximum(costs[:, 0], ceiling)))[:16]
    return first[order], costs[order[0]]


@pytest.mark.parametrize("corner", ["regular", "full", "empty", "hot"])
@pytest.mark.parametrize("weights", [(1, 1, 1, 1e-3), (1, 1, 0.5, 0.5), (1, 1, 1e-3, 1)])
@pytest.mark.parametrize("seed", range(4))
def test_search_reaches_what_exhaustive_search_finds(
    corner: str, weights: tuple[float, float, float, float], seed: int
) -> None:
    problem = case(seed, corner, 2, N_STEPS, weights, like=seed % 2 == 0)
    objectives = problem.horizon.split(None, 2000).incumbent.objectives
    per_kw = problem.costs[0, :, 0].max()
    assert objectives[0] <= exhaustive(problem)[0] + 0.05 * per_kw
    # No schedule is better in the second group without being worse in the first.
    best = exhaustive(problem, ceiling=objectives[0])
    assert best[0] > objectives[0] or objectives[1] <= best[1] * (1 + 1e-3)


def test_the_work_near_empty_grows_about_in_proportion_to_the_number_of_strings() -> None:
    def rollouts(n_strings: int) -> int:
        problems = [case(seed, "empty", n_strings, 8, like=True) for seed in range(3)]
        return sum(problem.horizon.split(None, 2000).rollouts for problem in problems)

    assert rollouts(32) < 2 * rollouts(2)
