"""Allocation of reactive power to the strings by a rule."""

from __future__ import annotations

import numpy as np

from bess.arrays import Array
from bess.control.policies.rule import water_fill
from bess.errors import InputError


def refuse_reactive(component: str, remedy: str, *, requested: bool) -> None:
    """Raise InputError if reactive power is requested from a component that does not support it."""
    if requested:
        raise InputError(
            f"[reactive]: {component} does not support reactive power; {remedy}, or leave out [reactive]"
        )


def share_equally(request_kw: Array, reactive_kvar: float, limit_kva: Array) -> Array:
    """Allocate reactive power in equal parts to the strings that are on, then to the others.

    Parameters
    ----------
    request_kw : ndarray, shape (n_strings,)
        Set-points of active power [kW], which has priority.
    reactive_kvar : float
        Total reactive power [kvar], signed.
    limit_kva : ndarray, shape (n_strings,)
        Maximum apparent power of each inverter in service [kVA].

    Returns
    -------
    ndarray, shape (n_strings,)
        Reactive power of each string [kvar]; the total is lower if the inverters reach their limits.
    """
    headroom = np.sqrt(np.maximum(limit_kva**2 - request_kw**2, 0.0))
    runs = request_kw != 0.0
    total, equal = abs(reactive_kvar), np.ones(request_kw.size)
    shares = water_fill(total, equal, np.where(runs, headroom, 0.0))
    remainder = total - float(shares.sum())
    if remainder > 0.0:
        shares += water_fill(remainder, equal, np.where(runs, 0.0, headroom))
    return np.copysign(shares, reactive_kvar)
