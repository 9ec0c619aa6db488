"""Measured state of a plant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bess.arrays import Array, ByValue, number_array
from bess.display import as_table, few, one_line
from bess.errors import InputError

TEMPERATURE_RANGE_C = (-60.0, 150.0)
SOH_CAPACITY_RANGE = (0.01, 1.5)
SOH_RESISTANCE_RANGE = (0.1, 100.0)
_LIMITS = {
    "soc": (0.0, 1.0),
    "temperature_c": TEMPERATURE_RANGE_C,
    "soh_capacity": SOH_CAPACITY_RANGE,
    "soh_resistance": SOH_RESISTANCE_RANGE,
    "cyclic_loss": (0.0, 1.0),
}


@dataclass(frozen=True, init=False, eq=False)
class State(ByValue):
    """State of every string at one instant.

    Attributes
    ----------
    soc : ndarray, shape (n_strings,)
        State of charge, 0 to 1.
    temperature_c : ndarray, shape (n_strings,)
        Mean temperature of each string [degC].
    soh_capacity : ndarray, shape (n_strings,)
        Capacity over that of the system file, 0.01 to 1.5; 1 if not given.
    soh_resistance : ndarray, shape (n_strings,)
        Resistance over that of the system file, 0.1 to 100; 1 if not given.
    cyclic_loss : ndarray, shape (n_strings,), or None
        Capacity loss by cycle ageing, relative to the capacity of the system file; the plant reports it, and
        the wear cost of the next cycle depends on it. None if unknown.
    """

    soc: Array
    temperature_c: Array
    soh_capacity: Array
    soh_resistance: Array
    cyclic_loss: Array | None

    def __init__(
        self,
        soc: ArrayLike,
        temperature_c: ArrayLike,
        soh_capacity: ArrayLike | None = None,
        soh_resistance: ArrayLike | None = None,
        cyclic_loss: ArrayLike | None = None,
    ) -> None:
        object.__setattr__(self, "soc", _vector("soc", soc))
        fresh = np.ones(self.soc.size)
        given = {
            "temperature_c": temperature_c,
            "soh_capacity": fresh if soh_capacity is None else soh_capacity,
            "soh_resistance": fresh if soh_resistance is None else soh_resistance,
        }
        if cyclic_loss is not None:
            given["cyclic_loss"] = cyclic_loss
        object.__setattr__(self, "cyclic_loss", None)
        for name, values in given.items():
            vector = _vector(name, values)
            if vector.size != fresh.size:
                raise InputError(f"state: soc has {fresh.size} strings, {name} has {vector.size}")
            object.__setattr__(self, name, vector)

    def _facts(self) -> dict[str, str]:
        facts = {"soc": few(self.soc), "temperature": few(self.temperature_c, "°C")}
        if not self.is_fresh:
            facts["capacity left"] = few(self.soh_capacity)
            facts["resistance over that when new"] = few(self.soh_resistance)
        return facts

    __repr__ = one_line
    _repr_html_ = as_table

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return self.soc.size

    @property
    def is_fresh(self) -> bool:
        """Whether all strings have the capacity and resistance of the system file (no ageing)."""
        return bool((self.soh_capacity == 1.0).all() and (self.soh_resistance == 1.0).all())


def _vector(name: str, values: ArrayLike) -> Array:
    array = number_array(f"state: {name}", values).copy()
    if array.ndim != 1 or array.size == 0:
        raise InputError(
            f"state: {name} must be one number for each string, not an array of shape {array.shape}"
        )
    low, high = _LIMITS[name]
    unit = " degC" if name == "temperature_c" else ""
    # One number for each string: a loop over them is quicker than calls of arrays.
    for index, value in enumerate(array.tolist()):
        # The comparison is false for NaN, so NaN is refused here as well.
        if not low - 1e-9 <= value <= high + 1e-9:
            raise InputError(
                f"state: string {index}: {name} {value:g}{unit} is outside [{low:g}, {high:g}]{unit}"
            )
    array.flags.writeable = False
    return array
