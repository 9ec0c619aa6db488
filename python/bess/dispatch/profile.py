"""Demand profiles from files, and bundled profiles."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from bess.arrays import Array
from bess.dispatch.forecast import whole_steps
from bess.dispatch.synthetic import (
    commercial_load,
    frequency_week,
    industrial_load,
    market_week,
    on_steps,
    peak_shaving_week,
    solar_power,
)
from bess.errors import InputError
from bess.files import Fill

if TYPE_CHECKING:
    import pandas as pd

_TO_KW: Final = {"W": 1e-3, "kW": 1.0, "MW": 1e3}
_TO_KVAR: Final = {"var": 1e-3, "kvar": 1.0, "Mvar": 1e3}
_FACTORS: Final = _TO_KW | _TO_KVAR
_SIGN: Final = {"discharge": 1.0, "charge": -1.0}

_DAY: Final = (
    (2.5, -1, "hi"), (0.5, -1, "lo"), (0.5, 0, "lo"), (4.75, 1, "hi"), (0.75, 1, "lo"), (0.5, 0, "lo"),
    (5.0, -1, "hi"), (0.75, -1, "lo"), (0.5, 0, "lo"), (4.75, 1, "hi"), (0.75, 1, "lo"), (0.5, 0, "lo"),
    (2.0, -1, "hi"), (0.25, 0, "lo"),
)  # fmt: skip
"""One day of the two-cycle profile: hours, direction (+1 discharge), level."""


def two_cycles_48h(hi_kw: float = 78.0, lo_kw: float = 30.0, dt_h: float = 0.25) -> Array:
    """Return two days of two arbitrage cycles each, shape (48 / dt_h,), kW in total, positive = discharge.

    From SOC 0.5 of the reference plant: blocks at `hi_kw` with tails at `lo_kw`.
    `dt_h` must divide a quarter of an hour, on which the blocks begin.
    """
    for name, value in (("hi_kw", hi_kw), ("lo_kw", lo_kw)):
        if not (np.isfinite(value) and value >= 0.0):
            raise InputError(f"profile two-cycle-48h: {name} {value} kW must be finite and >= 0 kW")
    level = {"hi": hi_kw, "lo": lo_kw}
    power = [sign * level[name] for _, sign, name in _DAY]
    quarters = [round(hours / 0.25) for hours, _, _ in _DAY]
    return on_steps(np.tile(np.repeat(power, quarters), 2).astype(np.float64), dt_h, "two-cycle-48h")


_FITTED_LEVELS_KW: Final = (-76.0, -5.0, 0.0, 78.0, 76.0, 0.0)
_FITTED_QUARTERS: Final = (18, 2, 4, 19, 5, 0, 22, 2, 2, 19, 0, 3)
_FITTED_START: Final = 16
"""Found by ``benches/fit_demand.py``: charge high and low, rest, discharge high and low, rest, twice."""


def fitted_48h(dt_h: float = 0.25) -> Array:
    """Return two days that reproduce most statements of the paper, shape (48 / dt_h,), kW in total.

    Fitted to the results of the paper (:mod:`bess.report.words.paper`), so agreement does not confirm them;
    the original demand is unpublished.
    """
    day = np.repeat(np.tile(_FITTED_LEVELS_KW, 2), _FITTED_QUARTERS)
    return on_steps(np.tile(np.roll(day, -_FITTED_START), 2), dt_h, "two-cycle-fitted-48h")


PROFILES: Final[dict[str, Callable[..., Array]]] = {
    "two-cycle-48h": two_cycles_48h,
    "two-cycle-fitted-48h": fitted_48h,
    "frequency-week": frequency_week,
    "peak-shaving-week": peak_shaving_week,
    "market-week": market_week,
}
"""Bundled profiles by name; their keywords are parameters of the profile and ``dt_h``."""


SITES: Final[dict[str, Callable[..., Array]]] = {
    "industrial-week": industrial_load,
    "commercial-week": commercial_load,
    "solar-week": solar_power,
}
"""Bundled loads and generation behind a meter by name; both are positive."""


def bundled_profile(name: str, **parameters: float) -> Array:
    """Return the bundled profile `name` [kW, positive = discharge]; see :data:`PROFILES`.

    Raises
    ------
    InputError
        There is no profile of that name.
    """
    if name not in PROFILES:
        raise InputError(f"profile {name!r} is not bundled; there are {', '.join(sorted(PROFILES))}")
    return PROFILES[name](**parameters)


def read_profile(
    path: str | PathLike[str],
    *,
    column: str | None = None,
    unit: str = "kW",
    positive: Literal["discharge", "charge"] = "discharge",
    scale: float = 1.0,
    dt_h: float = 0.25,
    time_zone: str | None = None,
    fill: Fill | None = None,
) -> pd.Series:
    """Read a demand profile from a CSV or Parquet file.

    Parameters
    ----------
    path : path
        CSV (any of comma, semicolon, tab; decimal point or comma) or Parquet, with a column of times.
    column : str, optional
        Name of the power column; needed if there are several.
    unit : {"kW", "W", "MW", "kvar", "var", "Mvar"}
        Unit of the file; a unit of reactive power for reactive profiles.
    positive : {"discharge", "charge"}
        Meaning of positive numbers in the file.
    scale : float
        Factor on the power, such as the peak of a profile in per unit; > 0.
    dt_h : float
        Control step [h]; the file's step must divide it (power is averaged) or be a multiple (power is held).
    time_zone : str, optional
        Zone of times without one, such as ``"Europe/Berlin"`` or ``"UTC"``.
    fill : {"previous", "interpolate", "previous_day"}, optional
        How to fill gaps and NaN, which are an error otherwise, however short.

    Returns
    -------
    pandas.Series
        Power [kW or kvar], positive = discharge, labelled at the start of the step, in UTC, regular;
        ``attrs`` hold ``units`` and ``repairs``.

    Raises
    ------
    InputError
        The file is not a demand profile, or a parameter is outside its range; the message gives place and
        remedy.
    """
    from bess.market.columns import read_columns
    from bess.market.files import reading
    from bess.market.regular import regular

    if unit not in _FACTORS:
        raise InputError(f"profile {path}: unit {unit!r} is unknown; allowed are {', '.join(_FACTORS)}")
    if positive not in _SIGN:
        raise InputError(f"profile {path}: positive {positive!r} is unknown; allowed are {', '.join(_SIGN)}")
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"profile {path}: scale {scale} must be finite and above 0")
    with reading(path) as (raw, repairs):
        columns = read_columns(raw, repairs)
        chosen = columns.choose(column, "power")
        _check_unit(chosen, unit)
        rows = columns.rows(chosen, time_zone, repairs, may_label_ends=True)
        series = regular(rows, fill, repairs, bridged_h=0.0)
    power = _resampled(str(path), series, dt_h) * (_SIGN[positive] * _FACTORS[unit] * scale)
    power = power.rename("demand_kw")
    power.attrs = {"units": "kvar" if unit in _TO_KVAR else "kW", "repairs": repairs}
    return power


def _check_unit(column: str, unit: str) -> None:
    """Raise InputError if a column name gives a unit other than `unit`."""
    from bess.market.files import fail
    from bess.market.units import names_currency, power_unit

    named = power_unit(column)
    if named != unit and names_currency(column):
        fail(1, f"column {column!r} holds prices, not power in {unit}; give a column of power")
    if named is not None and named != unit:
        alike = _TO_KVAR if unit in _TO_KVAR else _TO_KW
        what = "reactive power" if unit in _TO_KVAR else "power"
        remedy = f"give unit={named!r}" if named in alike else f"give a column of {what}"
        fail(1, f"column {column!r} is in {named}, not in {unit}; {remedy}")


def _resampled(name: str, series: pd.Series, dt_h: float) -> pd.Series:
    """Average finer values over control steps of `dt_h`, or hold coarser ones; drop an incomplete step."""
    import pandas as pd

    file_h = (series.index[1] - series.index[0]) / pd.Timedelta(hours=1)
    values = series.to_numpy()
    averages = file_h <= dt_h
    per_step = whole_steps(dt_h, file_h) if averages else whole_steps(file_h, dt_h)
    if per_step is None:
        minutes, control = (f"{60.0 * hours:g} min" for hours in (file_h, dt_h))
        raise InputError(
            f"profile {name}: its step of {minutes} is neither a fraction nor a multiple of the control step "
            f"of {control}; give a file with steps of {control}"
        )
    if averages:
        whole = values.size // per_step
        if whole == 0:
            raise InputError(
                f"profile {name}: {values.size * file_h:g} h is less than one step of {dt_h:g} h"
            )
        values = values[: whole * per_step].reshape(whole, per_step).mean(axis=1)
    else:
        values = values.repeat(per_step)
    index = pd.date_range(series.index[0], periods=values.size, freq=pd.Timedelta(hours=dt_h), name="time")
    return pd.Series(values, index=index)
