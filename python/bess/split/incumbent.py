"""The best split known: requests with the objectives of their roll-out, compared in order of priority."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.split.lexicographic import cap

Array = NDArray[np.float64]


class Incumbent:
    """The best requests offered so far.

    Each group has a ceiling, its smallest value seen plus its tolerance; requests under all ceilings compare
    by the last group. The ceilings only fall, so that small steps within a tolerance cannot add up.

    Attributes
    ----------
    request : ndarray, shape (n_strings, n_steps)
        Requests [kW], signed.
    objectives : ndarray, shape (n_groups,)
    """

    def __init__(self, request: Array, objectives: Array, abs_tol: Array, rel_tol: Array) -> None:
        self.request, self.objectives = request, objectives
        self._abs_tol, self._rel_tol = abs_tol, rel_tol
        self._lowest = objectives.copy()

    @property
    def ceilings(self) -> Array:
        """Ceiling of each group; there is none for the last."""
        return np.array([*(self._ceiling(group) for group in range(self.objectives.size - 1)), np.inf])

    @property
    def standing(self) -> Array:
        """Smallest value seen of each group, and of the last the value held."""
        return np.array([*self._lowest[:-1], self.objectives[-1]])

    def offer(self, request: Array, objectives: Array) -> None:
        """Take ``request`` if it comes before what is held."""
        if not np.all(np.isfinite(objectives)):
            return
        for group in range(objectives.size - 1):
            self._lowest[group] = min(self._lowest[group], objectives[group])
            if objectives[group] > self._ceiling(group):
                break
        if self._rank(objectives) < self._rank(self.objectives):
            self.request, self.objectives = request, objectives

    def _rank(self, objectives: Array) -> tuple[float, ...]:
        over = (max(objectives[g] - self._ceiling(g), 0.0) for g in range(objectives.size - 1))
        return (*over, objectives[-1])

    def _ceiling(self, group: int) -> float:
        return cap(self._lowest[group], self._abs_tol[group], self._rel_tol[group])


def repaired(share: Array, demand_kw: Array, limit_kw: Array) -> Array:
    """Return requests [kW, magnitudes] in the proportions of ``share`` that meet the demand within the
    limits.

    What a string cannot take goes to the others in proportion to the room they have.

    Parameters
    ----------
    share : ndarray, shape (..., n_strings, n_steps)
        Wanted powers, in any unit, ``>= 0``; a batch along leading axes.
    demand_kw : ndarray, shape (n_steps,)
        Magnitude, at most the sum of the limits.
    limit_kw : ndarray, shape (n_strings, n_steps)
    """
    share = np.where(share.sum(axis=-2, keepdims=True) > 0.0, share, limit_kw)
    request = np.minimum(_fractions(share) * demand_kw, limit_kw)
    room = limit_kw - request
    missing = demand_kw - request.sum(axis=-2, keepdims=True)
    kept: Array = np.clip(request + _fractions(room) * missing, 0.0, limit_kw)
    return kept


def _fractions(share: Array) -> Array:
    """Parts of each string in the sum over strings, 0 where that vanishes."""
    total = share.sum(axis=-2, keepdims=True)
    parts: Array = share / np.where(total > 0.0, total, 1.0)
    return parts
