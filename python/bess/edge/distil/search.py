"""Weights by a derivative-free search on the cost of closed loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from bess.arrays import Array
from bess.control.explicit import N_WEIGHTS, decision
from bess.edge.distil.training import TrainingSet
from bess.optional_dependencies import extra

POPULATION: Final = 32
"""Controllers of a generation; they run side by side."""
GENERATIONS: Final = 150
"""Generations of a search."""
SPREAD: Final = 0.4
"""Standard deviation of the weights of the first generation."""


def first_weights() -> Array:
    """Where the search begins: strings kept together, a reserve near empty, half of what is lost missing
    later."""
    weights = np.zeros(N_WEIGHTS)
    for side in (0, decision.PER_SIDE):
        weights[side + decision.W_BALANCE] = 1.0
        weights[side + decision.W_RESERVE : side + decision.W_RESERVE + 3] = 1.0, 1.0, 0.1
        weights[side + decision.W_RESERVE_LOWEST : side + decision.W_RESERVE_LOWEST + 3] = 0.5, 0.5, 0.0
        weights[side + decision.W_FULL] = 0.1
        weights[side + decision.W_WORTH : side + decision.W_WORTH_SCARCE + 1] = 0.5, 1.0
    weights[decision.W_KEEPS] = 0.85
    return weights


def fit(lessons: TrainingSet, generations: int, update: Callable[[int], None]) -> tuple[Array, float]:
    """Find weights with little cost by covariance matrix adaptation (CMA-ES) [1]_.

    The cost over weights is rugged, for a small change can switch another string on, and everything after
    that differs. The search needs no slopes and repeats to the last bit.

    Parameters
    ----------
    lessons : Lessons
        Give the cost of a generation in one call.
    generations : int
        How many generations to try.
    update : callable
        Told the number of each generation that is done.

    Returns
    -------
    weights : ndarray, shape (n_weights,)
        The best ones seen.
    cost : float
        Their cost [kWh].

    References
    ----------
    .. [1] Hansen, N.: The CMA evolution strategy: a tutorial. 2016, arXiv:1604.00772.
    """
    with extra("distil", "bess distil"):
        import cma

    best = first_weights()
    least = float(lessons.costs(best[None])[0])
    strategy = cma.CMAEvolutionStrategy(
        best, SPREAD, {"popsize": POPULATION, "seed": 1, "verbose": -9, "maxiter": generations}
    )
    for generation in range(generations):
        tried = np.array(strategy.ask())
        costs = lessons.costs(tried)
        strategy.tell(list(tried), costs.tolist())
        if costs.min() < least:
            least, best = float(costs.min()), tried[costs.argmin()].copy()
        update(generation + 1)
    return best, least
