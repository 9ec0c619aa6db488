"""Synthetic demand in the manner of three services, made by code: no file, the same on every machine.

All are sized for a pair of reference strings (184 kW, 532 kWh) that starts half full, and are
meant to be scaled with the plant. They are of the kind of the service and describe no real week.
"""

from typing import Final

import numpy as np

from bess.ems.forecast import Array, steps_in

_QUARTERS_PER_DAY: Final = 96
_QUARTERS_PER_WEEK: Final = 7 * _QUARTERS_PER_DAY


def frequency_week(dt_h: float = 0.25, seed: int = 1) -> Array:
    """Return a week like frequency control: small, restless, of both signs, 0 within a dead band [kW].

    Twenty-four waves of half an hour to nine hours with random phases, and 2 kW of charging that make up for
    losses.
    """
    random = np.random.default_rng(seed)
    period_h = np.geomspace(0.6, 9.0, 24)
    phase = random.uniform(0.0, 2.0 * np.pi, period_h.size)
    hours = (np.arange(_QUARTERS_PER_WEEK) + 0.5)[:, None] * 0.25
    wave = np.cos(2.0 * np.pi * hours / period_h + phase).sum(axis=1)
    power_kw = 11.0 * wave
    power_kw[np.abs(power_kw) < 6.0] = 0.0
    return _on_steps(np.clip(power_kw - 2.0 * (power_kw != 0.0), -150.0, 150.0), dt_h, "frequency-week")


def peak_shaving_week(dt_h: float = 0.25, seed: int = 2) -> Array:
    """Return a week like the shaving of an industrial load: peaks by day, charged at night, idle weekends.

    In kW. On each of five days three to five peaks of a half to two hours and 30 to 140 kW; in the night
    after, what left the store comes back with 8 % for losses, at even power from 20:00 to 04:00.
    """
    random = np.random.default_rng(seed)
    power_kw = np.zeros(_QUARTERS_PER_WEEK)
    for day in range(5):
        peaks_kw = np.zeros(_QUARTERS_PER_DAY)
        for _ in range(random.integers(3, 6)):
            first = int(random.integers(28, 68))
            last = min(first + int(random.integers(2, 9)), 72)
            shape_kw = random.uniform(30.0, 140.0) * random.uniform(0.6, 1.0, last - first)
            peaks_kw[first:last] = np.maximum(peaks_kw[first:last], shape_kw)
        peaks_kw *= min(1.0, 4.0 * 330.0 / peaks_kw.sum())
        midnight = day * _QUARTERS_PER_DAY
        power_kw[midnight : midnight + _QUARTERS_PER_DAY] += peaks_kw
        power_kw[midnight + 80 : midnight + 112] = -1.08 * peaks_kw.sum() / 32.0
    return _on_steps(power_kw, dt_h, "peak-shaving-week")


def market_week(dt_h: float = 0.25, seed: int = 3) -> Array:
    """Return a week like trade at an exchange: full power in the best hours, part of it in others [kW].

    Charging by night and at noon, discharging in the morning and in the evening; hours by hours at full
    power, half of it or none, with up to two cycles a day.
    """
    random = np.random.default_rng(seed)
    power_kw = np.zeros((7, 24))
    levels = np.array([0.35, 0.5, 0.75, 1.0])
    for day in power_kw:
        for sign, first, hours in ((-1.08, 1, 3), (1.0, 6, 3), (-1.08, 11, 4), (1.0, 17, 4)):
            start = first + random.integers(0, 2)
            share = random.choice(levels, hours)
            energy = float(np.minimum(random.uniform(280.0, 420.0), 170.0 * share.sum()))
            day[start : start + hours] = sign * share * (energy / share.sum())
    return _on_steps(np.clip(power_kw, -184.0, 184.0).ravel().repeat(4), dt_h, "market-week")


def _on_steps(quarters_kw: Array, dt_h: float, name: str) -> Array:
    """Return quarters of an hour on control steps that divide them."""
    return quarters_kw.repeat(steps_in(0.25, dt_h, f"profile {name}: its quarter of an hour"))
