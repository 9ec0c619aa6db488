"""Piecewise linear envelopes of tables: convex from below, concave from above."""

from __future__ import annotations

import numpy as np

from bess.arrays import Array

Lines = tuple[Array, Array]
"""Intercepts and slopes of straight lines."""


def lower_hull(x: Array, y: Array) -> list[int]:
    """Return the indices of the knots on the lower convex hull (Andrew's monotone chain), ends included.

    The lines between them are the largest convex function nowhere above the table; ``x`` must ascend.
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
    hull = lower_hull(x, y)
    slope, first = np.unique(np.diff(y[hull]) / np.diff(x[hull]), return_index=True)
    start = np.array(hull)[first]
    return y[start] - slope * x[start], slope


def lines_above(x: Array, y: Array) -> Lines:
    """Return the lines whose minimum is the smallest concave function above a table."""
    if x.size == 1:
        return np.array([y[0]]), np.zeros(1)
    intercept, slope = lines_below(x, -y)
    return -intercept[::-1], -slope[::-1]


def line_above(x: Array, y: Array) -> tuple[float, float]:
    """Return intercept and slope of the lowest line above a table that touches its left end."""
    slope = float(np.max((y[1:] - y[0]) / (x[1:] - x[0])))
    return float(y[0] - slope * x[0]), slope


def chord_above(x: Array, y: Array) -> tuple[float, float]:
    """Return intercept and slope of the chord between the ends of a table, raised above all its values."""
    slope = float((y[-1] - y[0]) / (x[-1] - x[0])) if x.size > 1 else 0.0
    return float((y - slope * x).max()), slope


def convex_below(x: Array, y: Array) -> Array:
    """Return the values at ``x`` of the largest convex function below a table."""
    if x.size < 3:
        return y
    hull = lower_hull(x, y)
    return np.interp(x, x[hull], y[hull])
