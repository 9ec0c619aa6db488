"""Typical years and short files, repeated over the years of a run."""

from datetime import datetime
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bess.arrays import step_of_times
from bess.errors import InputError
from bess.market.columns import Columns
from bess.market.files import Repairs

_NOMINAL_YEAR: Final = 2001
_DAYS: Final = 365


def on_one_year(columns: Columns, repairs: Repairs) -> tuple[Columns, bool]:
    """Return the columns of a typical year with all months in one calendar year, and whether this applied."""
    wall = columns.times["wall"]
    n_years, n_days = wall.dt.year.nunique(), wall.dt.normalize().nunique()
    if columns.typical or n_years == 1 or n_days != _DAYS:
        return columns, columns.typical
    dates = pd.DataFrame({"year": _NOMINAL_YEAR, "month": wall.dt.month, "day": wall.dt.day})
    placed = pd.to_datetime(dates, errors="coerce") + (wall - wall.dt.normalize())
    if not placed.is_monotonic_increasing:
        return columns, False
    text = f"laid the months of {n_years} years onto {_NOMINAL_YEAR}: a typical year"
    repairs.add("typical-year", text, wall.size, wall.index[0])
    return columns.at(placed), True


def over_years(series: pd.Series, first: datetime, last: datetime) -> pd.Series:
    """Repeat a typical year over the time from `first` to `last` (UTC), on the same days of the calendar.

    Where the year has no 29 February, that day is like the 28th.

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

    Raises
    ------
    InputError
        The series is not regular, or times have no zone.
    """
    step, (begin, end) = _checked("over_years", series, first, last)
    if begin > end:
        raise InputError(f"over_years: the period ends at {last}, before it begins at {first}")
    year = series.index[len(series) // 2].year
    start = series.index[0] + (begin - series.index[0]) // step * step
    index = pd.date_range(start, end + step, freq=step)
    place = (_years_before(index, index.year - year) - series.index[0]) // step
    return pd.Series(series.to_numpy()[place % len(series)], index=index, name=series.name)


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

    Raises
    ------
    InputError
        The series is not regular, or times have no zone.
    """
    step, (until,) = _checked("extended", series, end)
    last = series.index[-1] + step
    if last >= until:
        return series
    year, index = pd.DateOffset(years=1), pd.date_range(last, until, freq=step, inclusive="left")
    if last - year >= series.index[0]:
        begins = pd.DatetimeIndex([last + k * year for k in range(index[-1].year - last.year + 1)])
        place = series.index.get_indexer(_years_before(index, begins.searchsorted(index, side="right")))
    else:
        days = (last - series.index[0]) // pd.Timedelta(days=1)
        if days < 1:
            return series
        place = (index - series.index[0]) // step % (pd.Timedelta(days=days) // step)
    longer: pd.Series = pd.concat([series, pd.Series(series.to_numpy()[place], index)]).rename(series.name)
    longer.index.name, longer.attrs = series.index.name, series.attrs
    return longer


def _checked(place: str, series: pd.Series, *moments: datetime) -> tuple[pd.Timedelta, list[pd.Timestamp]]:
    """Return the step of a regular series, and moments in its time zone."""
    index = series.index if isinstance(series, pd.Series) else None
    if not isinstance(index, pd.DatetimeIndex) or index.tz is None:
        raise InputError(f"{place}: needs a pandas series with a time-zone aware index")
    if step_of_times(place, series) is None:
        raise InputError(f"{place}: {len(series)} values are too few; give at least two")
    for moment in moments:
        if not isinstance(moment, datetime) or moment.tzinfo is None:
            raise InputError(f"{place}: {moment!r} must be a time with a zone, such as {index[0]!r}")
    return index[1] - index[0], [pd.Timestamp(moment).tz_convert(index.tz) for moment in moments]


def _years_before(index: pd.DatetimeIndex, years: ArrayLike) -> pd.DatetimeIndex:
    """Return each time so many `years` earlier, which ascend; 29 February becomes the 28th if need be."""
    of_each = [index[years == k] - pd.DateOffset(years=k) for k in np.unique(years)]
    earlier: pd.DatetimeIndex = of_each[0].append(of_each[1:])
    return earlier
