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


def whole_watts(power_kw: NDArray[np.float64]) -> list[int | None]:
    """Return set-points in whole W, each less than 1 W off; None for none.

    Each is cut towards zero. What that takes from the sum goes back, 1 W each, to those that lost most, so
    that the sum is that of ``power_kw``, cut once. Less than 1 W is nothing.
    """
    exact = 1000.0 * np.nan_to_num(power_kw)
    exact += np.copysign(_HAIR_W, exact)
    whole = np.trunc(exact)
    lost = np.where(whole == 0.0, 0.0, exact - whole)
    missing = math.trunc(exact.sum()) - int(whole.sum())
    sign = math.copysign(1.0, missing)
    order = np.argsort(-sign * lost, kind="stable")[: abs(missing)]
    whole[order] += sign * (sign * lost[order] > 2.0 * _HAIR_W)
    return [None if math.isnan(kw) else int(w) for kw, w in zip(power_kw, whole, strict=True)]
