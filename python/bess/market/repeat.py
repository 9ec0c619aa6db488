"""Series that go on after the end of their file, for runs over decades."""

from datetime import datetime

import pandas as pd


def prolonged(series: pd.Series, end: datetime) -> pd.Series:
    """Let a series begin again after its end, until `end`.

    The last year of the series follows year by year, on the same days of the calendar (UTC): where the series
    has no 29 February, that day is like the 28th; one that it has is left out in other years. Weekdays and
    the hours of daylight saving time move by a day or two. A series of less than a year follows from its
    first whole day to its last.

    Parameters
    ----------
    series : pandas.Series
        Regular, at least a day, in UTC.
    end : datetime
        Where to stop, time-zone aware.

    Returns
    -------
    pandas.Series
        The same values and step, and what follows; unchanged if it reaches `end` already.
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
