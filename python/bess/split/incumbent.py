"""The best split known: requests with the objectives of their roll-out, compared in order of priority."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.split.lexicographic import cap

Array = NDArray[np.float64]


def is_better(candidate: Array, incumbent: Array, abs_tol: Array, rel_tol: Array) -> bool:
    """Whether ``candidate`` comes first: objectives by priority, differences within a tolerance do not count but for
    the last group."""
    for group, (new, old) in enumerate(zip(candidate, incumbent, strict=True)):
        tolerance = cap(old, abs_tol[group], rel_tol[group]) - old
        if group == candidate.size - 1:
            return bool(new < old)
        if new < old - tolerance:
            return True
        if new > old + tolerance:
            return False
    return False


def repaired(share: Array, demand_kw: Array, limit_kw: Array) -> Array:
    """Return requests [kW, magnitudes] in the proportions of ``share`` that meet the demand within the limits.

    What a string cannot take goes to the others in proportion to the room they have.

    Parameters
    ----------
    share : ndarray, shape (n_strings, n_steps)
        Wanted powers, in any unit, ``>= 0``.
    demand_kw : ndarray, shape (n_steps,)
        Magnitude, at most the sum of the limits.
    limit_kw : ndarray, shape (n_strings, n_steps)
    """
    total = share.sum(axis=0)
    share = np.where(total > 0.0, share, limit_kw)
    request = np.minimum(share * (demand_kw / np.maximum(share.sum(axis=0), 1e-300)), limit_kw)
    room = limit_kw - request
    missing = demand_kw - request.sum(axis=0)
    request = request + room * (missing / np.maximum(room.sum(axis=0), 1e-300))
    return np.clip(request, 0.0, limit_kw)
