"""Ambient temperature from weather files."""

import re
from os import PathLike
from typing import Final

import pandas as pd

from bess.files import Fill
from bess.market.columns import read_columns
from bess.market.files import fail, first_line, reading
from bess.market.regular import regular
from bess.market.units import check_temperature_unit
from bess.market.years import on_one_year

_NAMES: Final = re.compile(
    r"temperature(?![a-z]).*|(air|ambient|outdoor|dry.?bulb)[ _-]?temp(erature)?.*|temp|temp_air|t_?air|"
    r"t_?amb(ient)?|ta|tt|tt_10|tt_tu|t2m|tl|lufttemperatur.*|au(ss|ß)entemperatur.*|temperatur\b.*|temperature_c|ambient_c",
    re.IGNORECASE,
)
_MIN_C: Final = -90.0
_MAX_C: Final = 60.0
_MISSING_C: Final = -999.0
"""Code of the German weather service for a missing value."""
_MAX_STEP_H: Final = 3.0


def read_weather(
    path: str | PathLike[str],
    *,
    column: str | None = None,
    time_zone: str | None = None,
    fill: Fill | None = None,
) -> pd.Series:
    """Read the ambient temperature of a weather file as a series in UTC without gaps.

    The reader accepts tables (CSV with any block above the header, Parquet, xlsx, JSON, in archives too) with
    a column of times, or of year, month, day, hour and minute. The German weather service (archives of its
    stations as they come), HiSim, Meteonorm, PVGIS, Open-Meteo and the NSRDB write such tables. It also
    accepts EPW files, and test reference years of the German weather service.

    Parameters
    ----------
    path : path
        The file.
    column : str, optional
        Name of the temperature column; needed if its title is ambiguous.
    time_zone : str, optional
        Time zone of time stamps without one, if the file does not name it. Weather services write UTC, which
        is assumed (and reported) by default.
    fill : {"previous", "interpolate", "previous_day"}, optional
        How to fill gaps longer than an hour, which are an error otherwise.

    Returns
    -------
    pandas.Series
        Ambient temperature [degC], labelled at the start of the step, in UTC; ``attrs`` hold ``units``,
        ``repairs`` and ``typical_year``: whether the file is a typical year, which
        :func:`bess.market.over_years` maps to calendar years.

    Raises
    ------
    InputError
        The file does not contain temperatures; one sentence gives file, line and remedy.
    """
    with reading(path) as (raw, repairs):
        columns, is_typical = on_one_year(read_columns(raw, repairs), repairs)
        times = columns.times
        if time_zone is None and columns.clock is None and times["offset_h"].isna().all():
            repairs.add("assumed-utc", "took times without a zone as UTC", len(times), times.index[0])
            time_zone = "UTC"
        named = [name for name in columns.names if _NAMES.fullmatch(name.strip())]
        chosen = columns.choose(named[0] if column is None and len(named) == 1 else column, "temperature")
        check_temperature_unit(chosen)
        rows = columns.rows(chosen, time_zone, repairs).replace({"value": _MISSING_C}, float("nan"))
        degrees = rows["value"]
        if (line := first_line((degrees < _MIN_C) | (degrees > _MAX_C))) is not None:
            fail(
                line,
                f"temperature {degrees[line]:g} degC in column {chosen!r} is outside "
                f"[{_MIN_C:g}, {_MAX_C:g}] degC; choose the right column, or convert it to degC first",
            )
        series = regular(rows, fill, repairs, max_step_h=_MAX_STEP_H).rename("temperature_c")
    series.attrs = {"units": "degC", "repairs": repairs, "typical_year": is_typical}
    return series
