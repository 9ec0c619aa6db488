"""Grid frequency from measured files, as the deviation from its nominal value."""

from os import PathLike
from typing import Final

import pandas as pd

from bess.files import Fill
from bess.market.columns import Columns, read_columns
from bess.market.files import Repairs, fail, first_line, reading
from bess.market.regular import regular

_NOMINAL_MHZ: Final = (50_000.0, 60_000.0)
_MAX_DEVIATION_MHZ: Final = 2_500.0
"""Maximum deviation of a grid in service."""
_MHZ_PER_HZ: Final = 1000.0
_IN_HZ: Final = 1.0
"""Deviations of which 99 % are smaller are in Hz: meters resolve 1 mHz, and 1 Hz is a blackout."""


def read_frequency(
    path: str | PathLike[str],
    *,
    column: str | None = None,
    time_zone: str | None = None,
    fill: Fill | None = None,
) -> pd.Series:
    """Read the grid frequency of a file as deviation from nominal, a series in UTC without gaps.

    Values may be Hz or mHz, absolute or a deviation, in a 50 or 60 Hz grid; their magnitude decides. Swapped
    day and month in the first twelve days of a month are corrected if only that puts the rows in order.

    Parameters
    ----------
    path : path
        CSV or Parquet, in a gzip or zip archive too, with a column of times.
    column : str, optional
        Name of the column; needed if there are several.
    time_zone : str, optional
        Time zone of time stamps without one, such as ``"UTC"``.
    fill : {"previous", "interpolate", "previous_day"}, optional
        How to fill gaps longer than an hour, which are an error otherwise; shorter ones are bridged.

    Returns
    -------
    pandas.Series
        Deviation [mHz], labelled at the start of the step, in UTC; ``attrs`` hold ``units`` and ``repairs``.

    Raises
    ------
    InputError
        The file does not contain frequencies; one sentence gives file, line and remedy.
    """
    with reading(path) as (raw, repairs):
        columns = _in_order(read_columns(raw, repairs), repairs)
        rows = columns.rows(columns.choose(column, "frequency"), time_zone, repairs)
        rows["value"] = _deviation_mhz(rows["value"], repairs)
        if (line := first_line(rows["value"].abs() > _MAX_DEVIATION_MHZ)) is not None:
            fail(
                line,
                f"is {rows['value'][line]:+g} mHz from the nominal frequency, more than "
                f"{_MAX_DEVIATION_MHZ:g} mHz; choose the right column, or leave the value out",
            )
        series = regular(rows, fill, repairs).rename("frequency_mhz")
    series.attrs = {"units": "mHz", "repairs": repairs}
    return series


def _in_order(columns: Columns, repairs: Repairs) -> Columns:
    """Restore swapped days and months."""
    wall = columns.times["wall"]
    early = wall.dt.day <= 12
    if wall.is_monotonic_increasing and wall.is_unique:
        return columns
    dates = pd.DataFrame({"year": wall.dt.year, "month": wall.dt.day.where(early, 1), "day": wall.dt.month})
    swapped = wall.mask(early, pd.to_datetime(dates) + (wall - wall.dt.normalize()))
    if not (swapped.is_monotonic_increasing and swapped.is_unique):
        return columns
    repairs.add_where("day-month", "swapped day and month, which brings the rows into order", early)
    return columns.at(swapped)


def _deviation_mhz(values: pd.Series, repairs: Repairs) -> pd.Series:
    usual = 0.0 if values.isna().all() else values.median()
    for nominal in _NOMINAL_MHZ:
        if abs(usual - nominal) < _MAX_DEVIATION_MHZ:
            return values - nominal
        if abs(usual * _MHZ_PER_HZ - nominal) < _MAX_DEVIATION_MHZ:
            return values * _MHZ_PER_HZ - nominal
    if values.abs().quantile(0.99) < _IN_HZ:
        repairs.add("hz-to-mhz", "took deviations below 1 as Hz", values.size)
        return values * _MHZ_PER_HZ
    return values
