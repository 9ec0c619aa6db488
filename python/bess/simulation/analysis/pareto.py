"""Pareto fronts: non-dominated points, hypervolume and knee.

All functions take ``points`` of shape ``(n_points, n_objectives)`` and one direction for each objective,
``"min"`` (the default) or ``"max"``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from bess.arrays import Array, Flags
from bess.errors import InputError

Direction = Literal["min", "max"]


def non_dominated(points: ArrayLike, directions: Sequence[Direction] | None = None) -> Flags:
    """Return a mask of the non-dominated points.

    A point dominates another if it is no worse in every objective and better in one. Equal points do not
    dominate each other, so all copies of a front point are in the front.

    Parameters
    ----------
    points
        Shape ``(n_points, n_objectives)``.
    directions
        ``"min"`` or ``"max"`` for each objective; all ``"min"`` if omitted.

    Returns
    -------
    ndarray of bool, shape ``(n_points,)``

    Raises
    ------
    InputError
        If a value is not finite, or the shapes do not fit.
    """
    costs = _as_costs(points, directions)
    mask = np.empty(len(costs), dtype=np.bool_)
    for index, cost in enumerate(costs):
        mask[index] = not np.any(np.all(costs <= cost, axis=1) & np.any(costs < cost, axis=1))
    return mask


def hypervolume(
    points: ArrayLike, reference: ArrayLike, directions: Sequence[Direction] | None = None
) -> float:
    """Return the volume that the points dominate, bounded by ``reference``; exact in any dimension.

    Points that do not dominate the reference add nothing. The unit is the product of the objectives' units.

    Parameters
    ----------
    points
        Shape ``(n_points, n_objectives)``.
    reference
        Shape ``(n_objectives,)``: a point worse than all points of interest, in the directions given.

    Raises
    ------
    InputError
        The reference does not have one value for each objective, or a value is not finite.

    Notes
    -----
    Slices along the last objective and recurses [1]_. Meant for fronts of hundreds of points in up to four or
    so objectives.

    References
    ----------
    .. [1] While, L., et al.: A faster algorithm for calculating hypervolume. IEEE Trans. Evol. Comput. 10
       (2006), doi:10.1109/TEVC.2005.851275.
    """
    costs = _as_costs(points, directions)
    bound = _as_costs(np.atleast_2d(np.asarray(reference, dtype=np.float64)), directions)
    if bound.shape != (1, costs.shape[1]):
        raise InputError(f"hypervolume: reference of {bound.shape[1]} values for {costs.shape[1]} objectives")
    return _dominated_volume(costs[np.all(costs < bound[0], axis=1)], bound[0])


def knee_point(points: ArrayLike, directions: Sequence[Direction] | None = None) -> int:
    """Return the index of the knee: the front point farthest from the chord between the extremes.

    Objectives are scaled to [0, 1] over the front (ideal to nadir). The distance is measured towards the
    ideal from the plane through the corners ``(1, 0, ...)``, ``(0, 1, ...)``. With two objectives these are
    the two ends of the front, so the plane is their chord [1]_.

    Raises
    ------
    InputError
        The set of points is empty.

    References
    ----------
    .. [1] Das, I.: On characterizing the knee of the Pareto curve. Structural Optimization 18 (1999),
       doi:10.1007/BF01195985.
    """
    costs = _as_costs(points, directions)
    front = np.flatnonzero(non_dominated(costs))
    if front.size == 0:
        raise InputError("knee_point: needs at least one point")
    low, high = costs[front].min(axis=0), costs[front].max(axis=0)
    # Avoids a division by zero for an objective that is equal over the whole front.
    span = np.where(high > low, high - low, 1.0)
    return int(front[np.argmin(((costs[front] - low) / span).sum(axis=1))])


def _as_costs(points: ArrayLike, directions: Sequence[Direction] | None) -> Array:
    costs: Array = np.array(points, dtype=np.float64)
    if costs.ndim != 2 or costs.shape[1] == 0:
        raise InputError(f"points must have shape (n_points, n_objectives), not {costs.shape}")
    if not np.all(np.isfinite(costs)):
        row, column = np.argwhere(~np.isfinite(costs))[0]
        raise InputError(
            f"points[{row}, {column}] = {costs[row, column]} is not a finite number; drop the point"
        )
    if directions is None:
        return costs
    if len(directions) != costs.shape[1]:
        raise InputError(f"{len(directions)} directions for {costs.shape[1]} objectives; give one for each")
    if unknown := [direction for direction in directions if direction not in ("min", "max")]:
        raise InputError(f"direction {unknown[0]!r} is neither 'min' nor 'max'")
    signs: Array = np.array([1.0 if direction == "min" else -1.0 for direction in directions])
    return costs * signs


def _dominated_volume(costs: Array, bound: Array) -> float:
    """Volume between ``bound`` and costs that are all strictly below it."""
    if len(costs) == 0:
        return 0.0
    if costs.shape[1] == 1:
        return float(bound[0] - costs.min())
    order = costs[np.argsort(costs[:, -1], kind="stable")]
    levels = np.append(order[:, -1], bound[-1])
    volume = 0.0
    for count, (low, high) in enumerate(pairwise(levels), start=1):
        if high > low:
            slab = order[:count, :-1]
            volume += float(high - low) * _dominated_volume(slab[non_dominated(slab)], bound[:-1])
    return volume
