"""Measured state of a plant, apart from its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.errors import InputError

TEMPERATURE_RANGE_C = (-60.0, 150.0)


@dataclass(frozen=True, init=False)
class State:
    """State of every string at one instant.

    Attributes
    ----------
    soc : ndarray, shape (n_strings,)
        State of charge, 0 to 1.
    temperature_c : ndarray, shape (n_strings,)
        Mean temperature of each string [degC].
    """

    soc: NDArray[np.float64]
    temperature_c: NDArray[np.float64]

    def __init__(self, soc: ArrayLike, temperature_c: ArrayLike) -> None:
        object.__setattr__(self, "soc", _vector("soc", soc, (0.0, 1.0), ""))
        object.__setattr__(
            self, "temperature_c", _vector("temperature_c", temperature_c, TEMPERATURE_RANGE_C, " degC")
        )
        if self.soc.shape != self.temperature_c.shape:
            raise InputError(
                f"state: soc has {self.soc.size} strings, temperature_c has {self.temperature_c.size}"
            )

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return self.soc.size


def _vector(name: str, values: ArrayLike, limits: tuple[float, float], unit: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"state: {name} must be one number for each string ({error})") from error
    if array.ndim != 1 or array.size == 0:
        raise InputError(
            f"state: {name} must be one number for each string, not an array of shape {array.shape}"
        )
    for index, value in enumerate(array):
        # The comparison is false for NaN, so NaN is refused here as well.
        if not limits[0] - 1e-9 <= value <= limits[1] + 1e-9:
            raise InputError(
                f"state: string {index}: {name} {value:g}{unit} is outside "
                f"[{limits[0]:g}, {limits[1]:g}]{unit}"
            )
    array.flags.writeable = False
    return array
