"""Fewer knots for a finely measured table (Ramer 1972, Douglas and Peucker 1973)."""

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array, one_number
from bess.errors import InputError


def reduced_knots(x: Array, rows: Array, max_error: float) -> tuple[NDArray[np.intp], float]:
    """Choose knots such that linear interpolation between them stays within ``max_error`` of every point.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Ascending axis.
    rows : ndarray, shape (m, n)
        Quantities that share the axis; each has to be met.
    max_error
        Largest allowed distance, in the unit of ``rows``.

    Returns
    -------
    indices : ndarray of int
        Chosen points, ascending, with both ends.
    error : float
        Largest distance that is left.

    Raises
    ------
    InputError
        ``max_error`` is negative or no number.
    """
    if not one_number("max_error", max_error) >= 0.0:
        raise InputError(f"max_error {max_error:g} must be at least 0")
    kept = {0, len(x) - 1}
    error = 0.0
    segments = [(0, len(x) - 1)]
    while segments:
        first, last = segments.pop()
        inner = slice(first + 1, last)
        share = (x[inner] - x[first]) / (x[last] - x[first])
        line = rows[:, [first]] + share * (rows[:, [last]] - rows[:, [first]])
        distance = np.abs(rows[:, inner] - line).max(axis=0, initial=0.0)
        if distance.size == 0:
            continue
        if distance.max() <= max_error:
            error = max(error, float(distance.max()))
            continue
        worst = first + 1 + int(np.argmax(distance))
        kept.add(worst)
        segments += [(first, worst), (worst, last)]
    return np.array(sorted(kept)), error
