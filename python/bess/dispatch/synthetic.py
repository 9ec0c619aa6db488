"""Synthetic demand, loads, solar power and grid frequency, computed without data files.

All are sized for a pair of reference strings (184 kW, 536 kWh) that starts half full, and are
meant to be scaled with the plant. They resemble the service and do not describe a real week. Values are
rounded, as processors disagree in the last bit of an exponential, and a search then takes another of two
nearly equal schedules.
"""

from typing import Final

import numpy as np

from bess.arrays import Array
from bess.dispatch.forecast import steps_in

_QUARTERS_PER_DAY: Final = 96
_QUARTERS_PER_WEEK: Final = 7 * _QUARTERS_PER_DAY


def frequency_week(dt_h: float = 0.25, seed: int = 1) -> Array:
    """Return a week of frequency control: small power of alternating sign, 0 within the dead band [kW].

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
    return on_steps(np.clip(power_kw - 2.0 * (power_kw != 0.0), -150.0, 150.0), dt_h, "frequency-week")


def peak_shaving_week(dt_h: float = 0.25, seed: int = 2) -> Array:
    """Return a week of peak shaving: discharge at daytime peaks, charging at night, idle weekends.

    In kW. On each of five days three to five peaks of a half to two hours and 30 to 140 kW; from 20:00
    to 04:00 the battery recharges at constant power, with 8 % for losses.
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
    return on_steps(power_kw, dt_h, "peak-shaving-week")


def market_week(dt_h: float = 0.25, seed: int = 3) -> Array:
    """Return a week of arbitrage: full power in the best hours, part load in others [kW].

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
    return on_steps(np.clip(power_kw, -184.0, 184.0).ravel().repeat(4), dt_h, "market-week")


def industrial_load(dt_h: float = 0.25, seed: int = 4) -> Array:
    """Return a week of the load of a factory with two shifts on five days [kW].

    A base of 90 kW, 150 kW more from 05:00 to 21:00 on working days, and machines that start for a quarter
    of an hour to an hour and a half, up to 420 kW in total.
    """
    random = np.random.default_rng(seed)
    load_kw = 90.0 + 6.0 * random.standard_normal(_QUARTERS_PER_WEEK)
    for day in range(5):
        first = day * _QUARTERS_PER_DAY
        load_kw[first + 20 : first + 84] += 150.0
        for _ in range(random.integers(6, 10)):
            start = first + int(random.integers(22, 76))
            load_kw[start : start + int(random.integers(1, 7))] += random.uniform(30.0, 140.0)
    return on_steps(np.clip(load_kw, 60.0, 420.0), dt_h, "industrial-week")


def commercial_load(dt_h: float = 0.25, seed: int = 5) -> Array:
    """Return a week of the load of a shop with cold rooms [kW]: 35 kW at night, about 100 kW when open."""
    random = np.random.default_rng(seed)
    hour = (np.arange(_QUARTERS_PER_WEEK) % _QUARTERS_PER_DAY) * 0.25
    day = np.arange(_QUARTERS_PER_WEEK) // _QUARTERS_PER_DAY
    is_open = (hour >= 6.0) & (hour < 20.0) & (day < 6)
    load_kw = 35.0 + 55.0 * is_open + 25.0 * np.exp(-(((hour - 17.5) / 2.5) ** 2)) * (day < 6)
    return on_steps(load_kw + 5.0 * random.standard_normal(_QUARTERS_PER_WEEK), dt_h, "commercial-week")


def solar_power(dt_h: float = 0.25, seed: int = 6) -> Array:
    """Return a spring week of a 250 kW photovoltaic plant [kW], with clear and cloudy days."""
    random = np.random.default_rng(seed)
    hour = (np.arange(_QUARTERS_PER_DAY) + 0.5) * 0.25
    clear = np.clip(np.sin(np.pi * (hour - 5.0) / 14.0), 0.0, None) ** 1.3
    days = []
    for clearness in random.permutation([1.0, 0.95, 0.9, 0.75, 0.6, 0.45, 0.3]):
        clouds = 1.0 - (1.0 - clearness) * random.uniform(0.4, 1.6, _QUARTERS_PER_DAY)
        days.append(250.0 * clear * np.clip(clouds, 0.05, 1.0))
    return on_steps(np.concatenate(days), dt_h, "solar-week")


def market_prices(seed: int = 8) -> Array:
    """Return a week of hourly prices [EUR/MWh]: low at night and at noon, high in the evening."""
    random = np.random.default_rng(seed)
    hour = np.arange(7 * 24) % 24
    weekend = np.arange(7 * 24) // 24 >= 5
    shape = 75.0 + 30.0 * np.exp(-(((hour - 8.0) / 2.0) ** 2)) + 60.0 * np.exp(-(((hour - 19.0) / 2.5) ** 2))
    noon = 55.0 * np.exp(-(((hour - 13.0) / 2.5) ** 2)) + 20.0 * (hour < 5)
    prices: Array = np.round(shape - noon - 15.0 * weekend + 6.0 * random.standard_normal(hour.size), 2)
    return prices


def frequency_deviation(seed: int = 7) -> Array:
    """Return a week of deviation from the nominal frequency every 10 s [mHz].

    Two first-order processes with time constants of one and ten minutes, and the sawtooth of hourly trading.
    Standard deviation (20 mHz) and autocorrelation (0.74 after a minute, 0.41 after five) are near those of
    continental Europe in May 2019.
    """
    random = np.random.default_rng(seed)
    count = 7 * 8640
    total = np.zeros(count)
    for spread_mhz, memory_s in ((14.0, 60.0), (13.0, 600.0)):
        kept = np.exp(-10.0 / memory_s)
        fresh = spread_mhz * np.sqrt(1.0 - kept**2) * random.standard_normal(count)
        value, path = 0.0, np.empty(count)
        for step, change in enumerate(fresh.tolist()):
            value = kept * value + change
            path[step] = value
        total += path
    hour = np.arange(count) % 360 / 360.0
    return np.round(total + 16.0 * (hour - 0.5), 3)


def on_steps(quarters_kw: Array, dt_h: float, name: str) -> Array:
    """Return the quarter-hourly values of profile ``name``, in whole W, on steps that divide a quarter."""
    return np.round(quarters_kw, 3).repeat(steps_in(0.25, dt_h, f"profile {name}: its quarter of an hour"))
