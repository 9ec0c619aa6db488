"""What set-points must hold to, in one place: limits, ramps, least power, and the sum.

Pure functions of arrays over the strings; powers are kW, positive = discharge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bess.arrays import Array, Flags
from bess.control.policies.rule import water_fill

POWER_TOLERANCE_KW: Final = 1e-9
"""Power that is rounding, and switches nothing."""


@dataclass(frozen=True)
class Envelope:
    """Signed range of each string's next set-point [kW], shape ``(n_strings,)``; ``low_kw <= high_kw``."""

    low_kw: Array
    high_kw: Array


def envelope(charge_kw: Array, discharge_kw: Array, last_kw: Array, ramp_kw: float | None) -> Envelope:
    """Range that limits and ramps leave.

    Parameters
    ----------
    charge_kw, discharge_kw
        Largest magnitudes in each direction. They come first: where a limit has fallen below what the ramp
        allows, the set-point falls with it.
    last_kw
        Set-points in force.
    ramp_kw
        Largest change within a control step; None without a limit.
    """
    low, high = -charge_kw, discharge_kw
    if ramp_kw is None:
        return Envelope(low, high)
    nearest = np.clip(last_kw, low, high)
    return Envelope(np.maximum(low, nearest - ramp_kw), np.minimum(high, nearest + ramp_kw))


def share(demand_kw: float, wanted_kw: Array, running: Flags, limits: Envelope, minimum_kw: Array) -> Array:
    """Set-points nearest to what is wanted that hold to everything and sum to the demand.

    Parameters
    ----------
    demand_kw
        Signed.
    wanted_kw
        Magnitudes, in the direction of the demand.
    running
        Strings that may be asked for power at all, beside those that a ramp holds above zero.
    limits
        From :func:`envelope`.
    minimum_kw
        Least magnitude of a string that gives any power.

    Returns
    -------
    ndarray, shape (n_strings,)
        Never of two directions, unless a ramp leads away from such set-points. Their sum falls short of the
        demand where limits, ramps or least powers leave no other way, and exceeds it only where a ramp keeps
        a string up.
    """
    discharge = demand_kw >= 0.0
    low = limits.low_kw if discharge else -limits.high_kw
    high = limits.high_kw if discharge else -limits.low_kw
    if (high < 0.0).any():
        # A ramp still holds a string in the other direction: all go towards zero first.
        return np.asarray(np.clip(0.0, low, high) * (1.0 if discharge else -1.0))
    forced = low > POWER_TOLERANCE_KW
    least = np.where(forced, np.maximum(low, np.minimum(minimum_kw, high)), minimum_kw)
    power = _magnitudes(abs(demand_kw), wanted_kw, (running | forced) & (high >= least), forced, least, high)
    return power if discharge else -power


def _magnitudes(
    demand_kw: float, wanted_kw: Array, active: Flags, forced: Flags, least: Array, most: Array
) -> Array:
    active = active & (most > POWER_TOLERANCE_KW) & (forced | (least <= demand_kw + POWER_TOLERANCE_KW))
    # Least powers above the demand in total: the string that is wanted least rests.
    while least[active].sum() > demand_kw + POWER_TOLERANCE_KW and (active & ~forced).any():
        may_rest = np.flatnonzero(active & ~forced)
        active[may_rest[np.argmin(wanted_kw[may_rest])]] = False
    floor = np.where(active, least, 0.0)
    ceiling = np.where(active, most, 0.0)
    power = np.clip(np.where(active, wanted_kw, 0.0), floor, ceiling)
    rest = demand_kw - float(power.sum())
    if rest > 0.0:
        room = ceiling - power
        power = np.minimum(power + water_fill(rest, room, room), ceiling)
    elif rest < 0.0:
        room = power - floor
        power = np.maximum(power - water_fill(-rest, room, room), floor)
    return power
