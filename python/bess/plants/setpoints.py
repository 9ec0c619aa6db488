"""Set-points on their way to a plant."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError

_HAIR_W = 1e-6
"""Rounding of a power in kW that was whole in W."""


def checked_setpoints(power_kw: NDArray[np.float64], n_strings: int) -> NDArray[np.float64]:
    """Return set-points, one for each string, finite or NaN.

    Raises
    ------
    InputError
        For another shape or an infinite power; nothing has been written then.
    """
    setpoints = np.asarray(power_kw, dtype=np.float64)
    if setpoints.shape != (n_strings,) or np.isinf(setpoints).any():
        raise InputError(f"set-points {setpoints} kW: expected {n_strings} finite powers, or NaN for none")
    return setpoints


def watts(power_kw: float) -> int:
    """Return a power in whole W, towards zero, so that no limit is exceeded by rounding."""
    return math.trunc(1000.0 * power_kw + math.copysign(_HAIR_W, power_kw))
