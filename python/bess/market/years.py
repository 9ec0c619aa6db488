"""Typical years and short files, repeated over the years of a run."""

from datetime import datetime
from typing import Final

import numpy as np
import pandas as pd

from bess.market.columns import Columns
from bess.market.files import Repairs

_NOMINAL_YEAR: Final = 2001
_WHOLE_DAYS: Final = (365, 366)


def on_one_year(columns: Columns, repairs: Repairs) -> tuple[Columns, bool]:
    """Return the columns of a typical year with all months in one calendar year, and whether this applied."""
    wall = pd.DatetimeIndex(columns.times["wall"])
    years = wall.year.unique()
    if columns.typical or not years.size > 1 or wall.normalize().unique().size not in _WHOLE_DAYS:
        return columns, columns.typical
    leap = wall.is_leap_year & (wall.month > 2)
    day = wall - wall.to_period("Y").to_timestamp() - pd.to_timedelta(leap.astype(int), unit="D")
    placed = pd.Timestamp(_NOMINAL_YEAR, 1, 1) + day
    if not placed.is_monotonic_increasing or placed[-1].year != _NOMINAL_YEAR:
        return columns, False
    lines = columns.times.index
    text = f"laid the months of {years.size} years onto {_NOMINAL_YEAR}: a typical year"
    repairs.add("typical-year", text, wall.size, lines[0])
    return columns.at(pd.Series(placed, lines)), True


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


def extended(series: pd.Series, end: datetime) -> pd.Series:
    """Repeat a series after its end, until `end`.

    The last year of the series follows year by year, on the same days of the calendar (UTC): where the series
    has no 29 February, that day is like the 28th; one that it has is left out in other years. Weekdays and
    the hours of daylight saving time move by a day or two. A series of less than a year follows from its
    first whole day to its last.

    Parameters
    ----------
    series : pandas.Series
        A regular series of at least a day, in UTC.
    end : datetime
        Where to stop, time-zone aware.

    Returns
    -------
    pandas.Series
        The series with its extension at the same step; unchanged if it already reaches `end`.
    """
    step = series.index[1] - series.index[0]
    last = series.index[-1] + step
    if last >= pd.Timestamp(end):
        return series
    year = pd.DateOffset(years=1)
    if last - year < series.index[0]:
        days = (last - series.index[0]) // pd.Timedelta(days=1)
        if days < 1:
            return series
        index = pd.date_range(last, end, freq=step, inclusive="left")
        per_period = pd.Timedelta(days=days) // step
        offset = (index - series.index[0]) // step % per_period
        following = [pd.Series(series.to_numpy()[offset], index=index)]
    else:
        following, years = [], 0
        while (begin := last + years * year) < pd.Timestamp(end):
            years += 1
            stop = min(last + years * year, pd.Timestamp(end))
            index = pd.date_range(begin, stop, freq=step, inclusive="left")
            source = series.index.get_indexer(index - years * year)
            following.append(pd.Series(series.to_numpy()[source], index=index))
    longer: pd.Series = pd.concat([series, *following]).rename(series.name)
    longer.index.name, longer.attrs = series.index.name, series.attrs
    return longer
