"""Formats without a table of header and rows, rewritten as such a table with their line numbers.

- EPW (EnergyPlus weather): no names of columns, hours 1 to 24 of a standard time given in the first line.
- Test reference years of the German weather service: columns of blanks below a block that ends with ``***``,
  hours 1 to 24, UTC+1.
- ``marginalpdbc`` of OMIE: year, month, day, period of the local day, prices of Portugal and Spain.
"""

import calendar
import re
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bess.market.files import fail, first_line
from bess.units import SECONDS_PER_HOUR, SECONDS_PER_MINUTE

_NOMINAL_YEAR: Final = "2001"
"""Calendar year of a typical year without a year or with several years; not a leap year."""
_HOURS: Final = 8760
"""Hours of a year without a 29 February."""
_EPW_TEMPERATURE: Final = 6
_EPW_TIME_ZONE: Final = 8
_OMIE: Final = "MARGINALPDBC"
_OMIE_CLOCK: Final = "Europe/Madrid"
_MAX_HOURS: Final = 25
_TRY_HEADER: Final = re.compile(r"^\s*(?:RW\s+HW|RG\s+IS)\s+MM\s+DD\s+HH\s", re.MULTILINE)


def rewritten(text: str) -> pd.DataFrame | None:
    """Return the cells of a file of one of these layouts by line, None for any other file.

    ``attrs["typical"]`` tells that they are the hours of a typical year.
    """
    if text.startswith("LOCATION,"):
        return _epw(text)
    if header := _TRY_HEADER.search(text[:20_000]):
        return _reference_year(text, header.start())
    return _omie(text) if text.startswith(_OMIE) else None


def _epw(text: str) -> pd.DataFrame:
    try:
        offset_h = float(text.split("\n", 1)[0].split(",")[_EPW_TIME_ZONE])
    except (IndexError, ValueError):
        fail(1, "the line LOCATION has no time zone in its ninth cell; fetch the file again")
    rows = {
        line: [*cells[:4], cells[_EPW_TEMPERATURE]]
        for line, cells in _cells(text, ",").items()
        if re.fullmatch(r"\d{4}", cells[0]) and len(cells) > 9
    }
    return _hours_of_a_year(rows, offset_h)


def _reference_year(text: str, header: int) -> pd.DataFrame:
    names = text[header:].lstrip().split("\n", 1)[0].split()
    wanted = [names.index(name) for name in ("MM", "DD", "HH", "t")]
    below = text.count("\n", 0, header)
    rows = {
        line: [_NOMINAL_YEAR, *(cells[i] for i in wanted)]
        for line, cells in _cells(text, None).items()
        if line > below + 1 and len(cells) == len(names) and cells[0].isdigit()
    }
    return _hours_of_a_year(rows, 1.0)


def _hours_of_a_year(rows: dict[int, list[str]], offset_h: float) -> pd.DataFrame:
    """Return the start of each hour from hours numbered by their ends."""
    if not rows:
        fail(1, "there is a header but no rows of hours; fetch the file again")
    frame = pd.DataFrame.from_dict(rows, "index", columns=["year", "month", "day", "hour", "value"])
    nominal, *others = frame["year"].unique()
    if others or (calendar.isleap(int(nominal)) and len(frame) == _HOURS):
        nominal = _NOMINAL_YEAR
    start = _days(frame.assign(year=nominal)) + _counted(frame["hour"], 60)
    if (line := first_line(start.isna())) is not None:
        _, month, day, hour, _ = frame.loc[line]
        fail(line, f"month {month}, day {day}, hour {hour} is no hour of {nominal}; correct the row")
    times = start.dt.strftime("%Y-%m-%d %H:%M") + offset_label(SECONDS_PER_HOUR * offset_h)
    hours = pd.DataFrame({"time": times, "temperature_c": frame["value"]})
    hours.attrs["typical"] = True
    return hours


def _omie(text: str) -> pd.DataFrame:
    rows = {
        line: cells[:6] for line, cells in _cells(text, ";").items() if len(cells) >= 6 and cells[0].isdigit()
    }
    if not rows:
        fail(1, f"there is nothing below {_OMIE}; fetch the file again")
    frame = pd.DataFrame.from_dict(rows, "index", columns=["year", "month", "day", "period", "PT", "ES"])
    periods = frame.groupby(["year", "month", "day"])["period"].transform("size")
    days = _days(frame).dt.tz_localize(_OMIE_CLOCK).dt.tz_convert("UTC")
    start = days + _counted(frame["period"], np.where(periods <= _MAX_HOURS, 60, 15))
    if (line := first_line(start.isna())) is not None:
        fail(line, f"{';'.join(rows[line][:4])} is no period of a day; fetch the file again")
    prices = {f"{zone} [EUR/MWh]": frame[zone] for zone in ("PT", "ES")}
    return pd.DataFrame({"time": start.dt.strftime("%Y-%m-%dT%H:%MZ"), **prices})


def offset_label(seconds: float) -> str:
    """Return an offset from UTC as text, such as ``+01:00``."""
    minutes = round(seconds / SECONDS_PER_MINUTE)
    return f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"


def _days(frame: pd.DataFrame) -> pd.Series:
    dates = frame["year"] + "-" + frame["month"] + "-" + frame["day"]
    return pd.to_datetime(dates, format="%Y-%m-%d", errors="coerce")


def _counted(numbers: pd.Series, minutes: ArrayLike) -> pd.Series:
    """Return the time from midnight to the start of a step counted from 1."""
    counted = pd.to_numeric(numbers.where(numbers.str.fullmatch(r"\d{1,3}")), errors="coerce")
    since: pd.Series = pd.to_timedelta((counted - 1) * np.asarray(minutes), unit="min")
    return since


def _cells(text: str, separator: str | None) -> dict[int, list[str]]:
    """Return the cells of every non-empty line."""
    lines = enumerate(text.splitlines(), 1)
    return {line: [cell.strip() for cell in row.split(separator)] for line, row in lines if row.strip()}
