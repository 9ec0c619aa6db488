"""Grid frequency from measured files, as the deviation from its nominal value."""

from dataclasses import replace
from os import PathLike
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.files import Fill
from bess.market.columns import Columns, read_columns
from bess.market.files import fail, path_text, read_bytes
from bess.market.regular import regular
from bess.market.repairs import Repairs
from bess.market.stamps import Stamps

_NOMINAL_MHZ: Final = (50_000.0, 60_000.0)
_FARTHEST_MHZ: Final = 2_500.0
"""Deviation beyond which a value is no frequency of a grid in service."""
_MHZ_PER_HZ: Final = 1000.0
_IN_HZ: Final = 1.0
"""A deviation that hardly ever exceeds this is in Hz: meters resolve 1 mHz, and 1 Hz is a blackout."""


def read_frequency(
    path: str | PathLike[str],
    *,
    column: str | None = None,
    time_zone: str | None = None,
    fill: Fill | None = None,
) -> pd.Series:
    """Read the grid frequency of a file as deviation from nominal, a series in UTC without gaps.

    Values may be Hz or mHz, absolute or the deviation, of a grid of 50 or 60 Hz: their size tells. Dates in
    which day and month of the first twelve days of a month are swapped are put right where that, and only
    that, brings the rows into order.

    Parameters
    ----------
    path : path
        CSV or Parquet, in a gzip or zip archive too, with a column of times.
    column : str, optional
        Name of the column; needed if there are several.
    time_zone : str, optional
        Clock of times without one, such as ``"UTC"``.
    fill : {"previous", "interpolate", "previous_day"}, optional
        How to fill gaps longer than an hour, which are an error otherwise; shorter ones are bridged.

    Returns
    -------
    pandas.Series
        Deviation [mHz], labelled at the start of the step, in UTC; ``attrs`` hold ``units`` and ``repairs``.

    Raises
    ------
    InputError
        The file cannot be read as such; one sentence names file, line and remedy.
    """
    name = path_text(path)
    repairs = Repairs()
    columns = _in_order(read_columns(name, read_bytes(path), repairs), repairs)
    rows = columns.rows(columns.choose(column, "frequency"), time_zone, repairs)
    rows = replace(rows, values=_deviation_mhz(rows.values, repairs))
    far = np.abs(rows.values) > _FARTHEST_MHZ
    if far.any():
        i = int(np.argmax(far))
        fail(
            name,
            int(rows.lines[i]),
            f"is {rows.values[i]:+g} mHz from the nominal frequency, more than {_FARTHEST_MHZ:g} mHz; choose "
            "the right column, or leave the value out",
        )
    series = regular(rows, fill, repairs).rename("frequency_mhz")
    series.attrs = {"units": "mHz", "repairs": repairs}
    repairs.report(name)
    return series


def _in_order(columns: Columns, repairs: Repairs) -> Columns:
    """Swap day and month where they were swapped."""
    wall = columns.stamps.wall
    if (np.diff(wall.asi8) > 0).all():
        return columns
    month, day = wall.month.to_numpy(), wall.day.to_numpy()
    early = day <= 12
    years = wall.to_numpy().astype("datetime64[Y]")
    dates = (years.astype("datetime64[M]") + (day - 1)).astype("datetime64[D]") + (month - 1)
    clock = wall - wall.normalize()
    swapped = pd.DatetimeIndex(np.where(early, dates + clock.to_numpy(), wall.to_numpy()))
    if not (np.diff(swapped.asi8) > 0).all():
        return columns
    text = "swapped day and month, which brings the rows into order"
    repairs.add("day-month", text, int(early.sum()), columns.lines[int(np.argmax(early))])
    return replace(columns, stamps=Stamps(swapped, columns.stamps.offset_h))


def _deviation_mhz(values: npt.NDArray[np.float64], repairs: Repairs) -> npt.NDArray[np.float64]:
    usual = float(np.nanmedian(values)) if not np.isnan(values).all() else 0.0
    for nominal in _NOMINAL_MHZ:
        if abs(usual - nominal) < _FARTHEST_MHZ:
            return values - nominal
        if abs(usual * _MHZ_PER_HZ - nominal) < _FARTHEST_MHZ:
            return values * _MHZ_PER_HZ - nominal
    if np.nanquantile(np.abs(values), 0.99) < _IN_HZ:
        repairs.add("hz-to-mhz", "took deviations below 1 as Hz", values.size)
        return values * _MHZ_PER_HZ
    return values
