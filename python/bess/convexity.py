"""Piecewise linear envelopes of tables: convex from below, concave from above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bess.arrays import Array

Lines = tuple[Array, Array]
"""Intercepts and slopes of straight lines."""


@dataclass(frozen=True)
class Envelope:
    """Underestimator ``max_j slope_j x + intercept_j`` of a table, and its chord from above.

    Attributes
    ----------
    slope, intercept : ndarray, shape (n_pieces,)
        Slopes and intercepts of the lines below the table.
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
        hull = lower_hull(x, y)
        slope = np.diff(y[hull]) / np.diff(x[hull])
        intercept = y[hull[:-1]] - slope * x[hull[:-1]]
        picked = np.linspace(0, slope.size - 1, n_pieces).round().astype(int)
        slope, intercept = slope[picked], intercept[picked]
        distance = y - np.max(slope * x[:, None] + intercept, axis=1)
        chord_slope = float(np.max((y[1:] - y[0]) / (x[1:] - x[0])))
        return cls(slope, intercept, chord_slope, float(y[0] - chord_slope * x[0]), float(distance.max()))


def lower_hull(x: Array, y: Array) -> list[int]:
    """Return the indices of the knots on the lower convex hull (Andrew's monotone chain), ends included.

    Between them runs the largest convex function that is nowhere above the table, whose ``x`` ascend.
    """
    hull: list[int] = []
    for i in range(x.size):
        while len(hull) >= 2:
            j, k = hull[-2], hull[-1]
            if (y[k] - y[j]) * (x[i] - x[j]) < (y[i] - y[j]) * (x[k] - x[j]):
                break
            hull.pop()
        hull.append(i)
    return hull


def lines_below(x: Array, y: Array) -> Lines:
    """Return the lines whose maximum is the largest convex function below a table."""
    envelope = Envelope.of_table(x, y, x.size - 1)
    slope, first = np.unique(envelope.slope, return_index=True)
    return envelope.intercept[first], slope


def lines_above(x: Array, y: Array) -> Lines:
    """Return the lines whose minimum is the smallest concave function above a table."""
    if x.size == 1:
        return np.array([y[0]]), np.zeros(1)
    envelope = Envelope.of_table(x, -y, x.size - 1)
    slope, first = np.unique(-envelope.slope, return_index=True)
    return -envelope.intercept[first], slope


def chord_above(x: Array, y: Array) -> tuple[float, float]:
    """Return intercept and slope of the chord between the ends of a table, raised until it is above all of
    it."""
    slope = float((y[-1] - y[0]) / (x[-1] - x[0])) if x.size > 1 else 0.0
    return float((y - slope * x).max()), slope


def convex_below(x: Array, y: Array) -> Array:
    """Return the values at ``x`` of the largest convex function below a table."""
    if x.size < 3:
        return y
    hull = lower_hull(x, y)
    return np.interp(x, x[hull], y[hull])
