"""Normalisation by a payoff table: each loss is divided by its range over the optima of the single
objectives."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bess import _core

Array = NDArray[np.float64]

SMALLEST_RANGE = 1e-6
"""Below this a loss does not depend on the split, and keeps its constant normalisation."""


def payoff_scale(
    scale_per_kw: Array, horizon: Callable[[Array], _core.ControlHorizon], max_rollouts: int
) -> Array:
    """Return ``scale_per_kw`` divided by the range of each loss over the payoff table.

    Parameters
    ----------
    scale_per_kw : ndarray, shape (n_strings, 4)
        Constant normalisation [1/kW].
    horizon
        Control model for given costs ``(n_groups, n_strings, 4)`` [1/kW].
    max_rollouts
        Effort for each row of the table.
    """
    n_losses = scale_per_kw.shape[1]
    single = np.zeros((n_losses, *scale_per_kw.shape))
    single[np.arange(n_losses), :, np.arange(n_losses)] = scale_per_kw.T
    rows = []
    for loss in range(n_losses):
        # Availability first: a loss alone would be least if nothing were delivered.
        groups = horizon(single[[0, loss]] if loss else single[[0]])
        request, _ = groups.greedy()
        request, _, _ = groups.search(request[None], max_rollouts)
        rows.append(request)
    table = np.asarray(horizon(single).evaluate(np.stack(rows)))
    spread = np.ptp(table, axis=0)
    return scale_per_kw / np.where(spread < SMALLEST_RANGE, 1.0, spread)
