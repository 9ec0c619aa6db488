"""Typical years: months of several years put together, or of none; and how they are laid onto real ones."""

from dataclasses import replace
from datetime import datetime
from typing import Final

import numpy as np
import pandas as pd

from bess.market.columns import Columns
from bess.market.repairs import Repairs
from bess.market.stamps import Stamps

_NOMINAL_YEAR: Final = 2001
_WHOLE_DAYS: Final = (365, 366)


def on_one_year(columns: Columns, repairs: Repairs) -> tuple[Columns, bool]:
    """Return the columns with the months of a typical year in one year, and whether they are of one."""
    wall = columns.stamps.wall
    years = wall.year.unique()
    if columns.typical or not years.size > 1 or wall.normalize().unique().size not in _WHOLE_DAYS:
        return columns, columns.typical
    day = wall - wall.to_period("Y").to_timestamp()
    leap = wall.is_leap_year & (wall.month > 2)
    placed = pd.Timestamp(_NOMINAL_YEAR, 1, 1) + (day - pd.to_timedelta(leap.astype(int), unit="D"))
    if not placed.is_monotonic_increasing or placed[-1].year != _NOMINAL_YEAR:
        return columns, False
    text = f"laid the months of {years.size} years onto {_NOMINAL_YEAR}: a typical year"
    repairs.add("typical-year", text, wall.size, columns.lines[0])
    return replace(columns, stamps=Stamps(pd.DatetimeIndex(placed), columns.stamps.offset_h)), True


def over_years(series: pd.Series, first: datetime, last: datetime) -> pd.Series:
    """Repeat a typical year over the time from `first` to `last` (UTC); 29 February is like the day before.

    Parameters
    ----------
    series : pandas.Series
        A year in UTC, as :func:`bess.market.read_weather` returns it.
    first, last : datetime
        Period to cover, time-zone aware.

    Returns
    -------
    pandas.Series
        The same step, from the last step at or before `first` on.
    """
    step = series.index[1] - series.index[0]
    year = series.index[len(series) // 2].year
    start = series.index[0] + (pd.Timestamp(first) - series.index[0]) // step * step
    index = pd.date_range(start, pd.Timestamp(last) + step, freq=step)
    leap_day = np.asarray((index.month == 2) & (index.day == 29))
    twin = index - pd.to_timedelta(leap_day.astype(int), unit="D")
    since = twin.tz_localize(None) - twin.tz_localize(None).to_period("Y").to_timestamp()
    leap_days = int(pd.Timestamp(year, 1, 1).is_leap_year) - twin.is_leap_year.astype(int)
    since += pd.to_timedelta(np.where(twin.month > 2, leap_days, 0), unit="D")
    offset = (pd.Timestamp(year, 1, 1, tz="UTC") + since - series.index[0]) // step
    values = series.to_numpy()[np.asarray(offset) % len(series)]
    return pd.Series(values, index=index, name=series.name)
