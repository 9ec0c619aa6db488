"""Convex envelopes of tables: the inverter loss enters the relaxation as the largest of a few straight
lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Envelope:
    """Underestimator ``max_j slope_j x + intercept_j`` of a table, and its chord from above.

    Attributes
    ----------
    slope, intercept : ndarray, shape (n_pieces,)
        Lines below the table.
    chord_slope, chord_intercept : float
        The lowest line through the table's left end that is above it.
    largest_distance : float
        Largest distance between table and underestimator, in the table's unit.
    """

    slope: Array
    intercept: Array
    chord_slope: float
    chord_intercept: float
    largest_distance: float

    @classmethod
    def of_table(cls, x: Array, y: Array, n_pieces: int) -> Envelope:
        """Take the lower convex hull of the knots; of its lines, ``n_pieces`` evenly spread ones."""
        hull = _lower_hull(x, y)
        slope = np.diff(y[hull]) / np.diff(x[hull])
        intercept = y[hull[:-1]] - slope * x[hull[:-1]]
        picked = np.linspace(0, slope.size - 1, n_pieces).round().astype(int)
        slope, intercept = slope[picked], intercept[picked]
        distance = y - np.max(slope * x[:, None] + intercept, axis=1)
        chord_slope = float(np.max((y[1:] - y[0]) / (x[1:] - x[0])))
        return cls(slope, intercept, chord_slope, float(y[0] - chord_slope * x[0]), float(distance.max()))


def _lower_hull(x: Array, y: Array) -> list[int]:
    """Indices of the knots on the lower convex hull (Andrew's monotone chain)."""
    hull: list[int] = []
    for i in range(x.size):
        while len(hull) >= 2:
            j, k = hull[-2], hull[-1]
            if (y[k] - y[j]) * (x[i] - x[j]) < (y[i] - y[j]) * (x[k] - x[j]):
                break
            hull.pop()
        hull.append(i)
    return hull
