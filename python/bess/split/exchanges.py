"""Schedules next to a given one that a descent does not find: its moves touch one or two steps each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.split.incumbent import repaired

Array = NDArray[np.float64]

ALIKE = 1e-3
"""Powers this close, as a share of the limit, are not worth an exchange."""


def exchanges(
    request_kw: Array,
    delivered_kw: Array,
    demand_kw: Array,
    limit_kw: Array,
    rng: np.random.Generator,
    most: int,
) -> Array:
    """Exchange what one string delivers in two steps.

    A string that is full or empty for part of the horizon delivers much the same energy whichever step it
    does so in: schedules that lie far apart shed almost the same, and a descent does not lead from one to the
    other. What a full or empty string was asked for in vain goes to the others.

    Parameters
    ----------
    request_kw, delivered_kw : ndarray, shape (n_strings, n_steps)
        Magnitudes.
    demand_kw : ndarray, shape (n_steps,)
        Magnitude.
    limit_kw : ndarray, shape (n_strings, n_steps)
    rng : numpy.random.Generator
        Decides their order, and which if there are more than ``most``.

    Returns
    -------
    ndarray, shape (n, n_strings, n_steps)
        Requests that meet the demand, magnitudes.
    """
    n_strings, n_steps = request_kw.shape
    first, second = np.triu_indices(n_steps, 1)
    differs = np.abs(delivered_kw[:, first] - delivered_kw[:, second]) > ALIKE * limit_kw.max()
    several = np.count_nonzero(limit_kw, axis=0) > 1
    string, pair = np.nonzero(differs & several[first] & several[second])
    chosen = rng.permutation(string.size)[:most]
    out = np.empty((chosen.size, n_strings, n_steps))
    for schedule, m, a, b in zip(out, string[chosen], first[pair[chosen]], second[pair[chosen]], strict=True):
        row = delivered_kw[m].copy()
        row[[a, b]] = row[[b, a]]
        others = np.arange(n_strings) != m
        room = limit_kw[others]
        least = np.maximum(demand_kw - room.sum(axis=0), 0.0)  # what the others cannot take
        schedule[m] = np.clip(row, least, np.minimum(limit_kw[m], demand_kw))
        schedule[others] = repaired(request_kw[others], demand_kw - schedule[m], room)
    return out


def swapped(request_kw: Array, order: NDArray[np.intp], most: int) -> Array:
    """Neighbours in an order of the strings change places from some step on.

    Which of two strings runs first is decided for the whole horizon at once: schedules in which they change
    places are all far from each other.

    Parameters
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
    order : ndarray of int, shape (n_strings,)
    most : int
        Of more swaps than these, every so many.

    Returns
    -------
    ndarray, shape (n, n_strings, n_steps)
        In proportion only: a string may now be asked for more than its limit.
    """
    n_strings, n_steps = request_kw.shape
    n_swaps = (n_strings - 1) * n_steps
    chosen = np.arange(0, n_swaps, -(-n_swaps // most))
    out = np.repeat(request_kw[None], chosen.size, axis=0)
    for schedule, swap in zip(out, chosen, strict=True):
        pair, step = divmod(int(swap), n_steps)
        one, other = order[pair], order[pair + 1]
        schedule[[one, other], step:] = schedule[[other, one], step:]
    return out
