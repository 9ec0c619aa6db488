"""Reactive power among the strings: by a rule, or with the least losses."""

from __future__ import annotations

import numpy as np

from bess.errors import InputError
from bess.numbers import Array
from bess.parameters import State, System
from bess.policies.rule import water_fill


def refuse_reactive(who: str, remedy: str, *, asked: bool) -> None:
    """Raise InputError where reactive power is asked of something that has none."""
    if asked:
        raise InputError(f"[reactive]: {who} knows no reactive power; {remedy}, or leave out [reactive]")


def shared_equally(request_kw: Array, reactive_kvar: float, limit_kva: Array) -> Array:
    """Share reactive power in equal parts among the strings that run, then among the others.

    Parameters
    ----------
    request_kw : ndarray, shape (n_strings,)
        Set-points of active power [kW], which comes first.
    reactive_kvar : float
        Total to share [kvar], signed.
    limit_kva : ndarray, shape (n_strings,)
        Largest apparent power of each inverter in service [kVA].

    Returns
    -------
    ndarray, shape (n_strings,)
        Reactive power of each string [kvar]; less in total where the inverters have no room for it.
    """
    room = np.sqrt(np.maximum(limit_kva**2 - request_kw**2, 0.0))
    runs = request_kw != 0.0
    total, equal = abs(reactive_kvar), np.ones(request_kw.size)
    shares = water_fill(total, equal, np.where(runs, room, 0.0))
    rest = total - float(shares.sum())
    if rest > 0.0:
        shares += water_fill(rest, equal, np.where(runs, 0.0, room))
    return np.copysign(shares, reactive_kvar)


def shared_at_least_loss(
    system: System,
    state: State,
    request_kw: Array,
    reactive_kvar: float,
    limit_kva: Array,
    start_kw: Array,
) -> Array:
    """Share reactive power so that the inverters lose least (docs/equations.md, R3).

    Parameters
    ----------
    system, state
        The plant and where it is.
    request_kw, reactive_kvar, limit_kva
        As for :func:`shared_equally`.
    start_kw : ndarray, shape (n_strings,)
        What the start of each inverter is worth [kW]; 0 for one that runs.

    Returns
    -------
    ndarray, shape (n_strings,)
        Reactive power of each string [kvar].
    """
    model = system.control_at(state)
    return np.asarray(model.share_reactive(request_kw, reactive_kvar, limit_kva, start_kw))
