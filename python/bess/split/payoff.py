"""Normalisation by a payoff table: each loss is divided by its range over the optima of the single
objectives."""

from __future__ import annotations

import numpy as np

from bess.numbers import Array
from bess.split.problem import SplitProblem

SMALLEST_RANGE = 1e-6
"""Below this a loss does not depend on the split, and keeps its constant normalisation."""


def payoff_scale(problem: SplitProblem, scale_per_kw: Array, abs_tol: float, rel_tol: float) -> Array:
    """Return ``scale_per_kw`` divided by the range of each loss over the payoff table.

    Parameters
    ----------
    problem
        What the table is for.
    scale_per_kw : ndarray, shape (n_strings, 4)
        Constant normalisation [1/kW].
    abs_tol, rel_tol
        Tolerances of the availability, which comes first in every row of the table.
    """
    n_losses = scale_per_kw.shape[1]
    single = np.zeros((n_losses, *scale_per_kw.shape))
    single[np.arange(n_losses), :, np.arange(n_losses)] = scale_per_kw.T
    rows = []
    for loss in range(n_losses):
        # Availability first: a loss alone would be least if nothing were delivered.
        costs = single[[0, loss]] if loss else single[[0]]
        tolerances = np.full(len(costs), abs_tol), np.full(len(costs), rel_tol)
        answer = problem.control(costs, costs, *tolerances).split(None, ROLLOUTS)
        rows.append(answer.incumbent.request_kw)
    every = problem.control(single, single, *(np.zeros(n_losses) for _ in range(2)))
    spread = np.ptp(every.evaluate(np.stack(rows)), axis=0)
    return scale_per_kw / np.where(spread < SMALLEST_RANGE, 1.0, spread)


ROLLOUTS = 2000
"""Effort of one descent for a row of the table."""
