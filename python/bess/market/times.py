"""Text cells to time stamps, and wall-clock times to UTC; the repeated hour is resolved by row order.

Times are tables by line with the columns ``wall``, the wall-clock time, and ``offset_h``, the UTC offset
given in the cell, otherwise NaN. Rows are tables by line of ``utc`` and ``value``.
"""

import re
from datetime import timedelta, timezone, tzinfo
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pandas as pd

from bess.errors import InputError
from bess.market.files import Repairs, fail, first_line

YEARS: Final = (1980, 2200)
"""Other years are numbers taken for times."""
_DAY_FIRST: Final = "%d/%m/%Y"
_MONTH_FIRST: Final = "%m/%d/%Y"
_DATES: Final = (
    "%Y-%m-%d", "%d.%m.%Y", _DAY_FIRST, _MONTH_FIRST, "%b %d, %Y", "%Y/%m/%d", "%d.%m.%y", "%d-%m-%Y",
    "%Y%m%d",
)  # fmt: skip
"""Dates tried in this order; the first that fits most cells is taken."""
_DIGITS: Final = {8: "%Y%m%d", 10: "%Y%m%d%H", 12: "%Y%m%d%H%M", 14: "%Y%m%d%H%M%S"}
"""Times of digits only, by their number: ``2024013112`` is 12:00, not 1:02."""
_UNIX: Final = re.compile(r"(\d{9,10}|\d{12,13})(\.0)?")
"""Times counted in seconds or milliseconds since 1970."""
_SPACES: Final = re.compile(r"[\s\u00a0\u202f]+")
_LABEL: Final = r"(?:\(?(Z|UTC|GMT|CET|CEST)\)?|([+-])(\d\d):?(\d\d))"
_TIME: Final = re.compile(
    r"(\d{1,4}[-./]\d\d?[-./]\d{1,4}|\d{8}|[A-Za-z]{3} \d\d?, \d{4})"
    r"(?:(?:T|:|,? )(\d\d?):?(\d\d)(?::(\d\d(?:\.\d+)?))?(?: ?([AaPp])[Mm])?(?: ?" + _LABEL + ")?)?"
)
_ISO: Final = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d)?) ?" + _LABEL + "?", re.ASCII)
_NAMED: Final = {"Z": 0.0, "UTC": 0.0, "GMT": 0.0, "CET": 1.0, "CEST": 2.0}
_FIXED: Final = re.compile(r"(?:UTC|GMT)?([+-])(\d{1,2})(?::?(\d\d))?", re.IGNORECASE)


def parse_times(cells: pd.Series, *, day_first: bool = True) -> pd.DataFrame:
    """Return the times of a column; raise InputError at the first cell that is not a time.

    Of ``03/04/2024`` the day comes first unless the other way the times lie closer together; without
    `day_first`, times that could be either are an error.
    """
    times = _iso(cells)
    if times is None:
        times = _read(cells, day_first=day_first)
    if (line := first_line(~times["wall"].dt.year.between(*YEARS))) is not None:
        fail(
            line,
            f"{cells[line]!r} in column {cells.name!r} is not a time like those around it; "
            "write 2024-01-31 14:00 or 31.01.2024 14:00, and check that columns are not swapped",
        )
    return times


def is_time(cell: str) -> bool:
    """Return whether a cell is a time stamp or an interval of two."""
    text = cell.partition(" - ")[0].strip()
    if not (text.isdigit() or _TIME.fullmatch(_SPACES.sub(" ", text))):
        return False
    return bool(_read(pd.Series([text], dtype=object))["wall"].dt.year.between(*YEARS).all())


def clock_of(name: str) -> tzinfo:
    """Return a time zone by name: an IANA zone or a fixed offset such as ``UTC+1``."""
    fixed = _FIXED.fullmatch(str(name).strip())
    if fixed:
        sign, hours, minutes = fixed.groups()
        shift = timedelta(hours=int(hours), minutes=int(minutes or 0))
        if shift < timedelta(hours=24):
            return timezone(-shift if sign == "-" else shift)
    try:
        return ZoneInfo(str(name).strip())
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise InputError(
            f"time_zone {name!r} is unknown; give a name such as Europe/Berlin, UTC or UTC+1"
        ) from None


def have_offsets(times: pd.DataFrame) -> bool:
    """Return whether the cells give UTC offsets; raise InputError if only some of them do."""
    labelled = times["offset_h"].notna()
    if (line := first_line(labelled != labelled.iloc[0])) is not None:
        has, other = ("has no", "has one") if labelled.iloc[0] else ("has a", "has none")
        fail(
            line,
            f"the time {has} UTC offset while line {times.index[0]} {other}: mixed time zones; "
            "write all times alike",
        )
    return bool(labelled.iloc[0])


def localise(wall: pd.DatetimeIndex, clock: tzinfo) -> pd.DatetimeIndex:
    """Return UTC: of two equal times the first is summer time; NaT for those that summer time skips."""
    first = ~wall.duplicated(keep="first")
    return wall.tz_localize(clock, ambiguous=first, nonexistent="NaT").tz_convert("UTC")


def by_label(times: pd.DataFrame) -> pd.DatetimeIndex:
    """Return UTC by the offsets in the cells; NaT without an offset."""
    return pd.DatetimeIndex(times["wall"] - pd.to_timedelta(times["offset_h"], unit="h")).tz_localize("UTC")


def in_utc(times: pd.DataFrame, clock: tzinfo) -> pd.DatetimeIndex:
    """Return UTC by the offset in the cell, otherwise by the time zone."""
    utc = localise(pd.DatetimeIndex(times["wall"]), clock)
    labelled = times["offset_h"].notna().to_numpy()
    return utc.where(~labelled, by_label(times)) if labelled.any() else utc


def to_utc(
    times: pd.DataFrame, values: pd.Series, clock: tzinfo, repairs: Repairs, *, drop_skipped: bool = True
) -> pd.DataFrame:
    """Place the rows of a file in UTC; a label in a cell has precedence over the clock.

    Rows in the hour that summer time skips are dropped if `drop_skipped` (exports, whose clock is known) or
    if they are empty; otherwise they are an error, since the clock is then probably another one.
    """
    rows = pd.DataFrame({"utc": in_utc(times, clock), "value": values.to_numpy()}, index=times.index)
    gone = rows["utc"].isna()
    if gone.any():
        line = first_line(gone & rows["value"].notna())
        if line is not None and not drop_skipped:
            fail(
                line,
                f"{times['wall'][line]:%Y-%m-%d %H:%M} does not exist in {clock}; "
                "if the clock of the file has no summer time, give time_zone='UTC+1' or its own offset",
            )
        repairs.add_where("spring-hour", "dropped the hour that summer time skips", gone)
        rows, times = rows[~gone], times[~gone]
    again = times["wall"].duplicated() & times["offset_h"].isna()
    if again.any():
        repairs.add_where("autumn-hour", "took the repeated hour of autumn in the order of the file", again)
        rows = _interleaved(rows, times, clock)
    _check_order(rows)
    return rows


def ends_day(utc: pd.Series, clock: tzinfo) -> bool:
    """Return whether the last row completes a day, with the step of the last two rows."""
    if utc.size < 2:
        return True
    end = (utc.iloc[-1] + (utc.iloc[-1] - utc.iloc[-2])).tz_convert(clock)
    return bool(end == end.normalize())


def _iso(cells: pd.Series) -> pd.DataFrame | None:
    """Return the times of a column if all cells are ISO 8601, otherwise None."""
    first = cells.iloc[0]
    match = _ISO.fullmatch(first)
    if match is None:
        return None
    length, end = match.end(1), first[match.end(1) :]
    matches = map(_ISO.fullmatch, cells)
    if not all(each and each.end(1) == length and each.string[length:] == end for each in matches):
        return None
    try:
        wall = np.array([cell[:length] for cell in cells], dtype="datetime64[s]")
    except ValueError:
        return None
    offset_h = _offset_h(*match.groups()[1:])
    return pd.DataFrame({"wall": wall, "offset_h": offset_h}, index=cells.index)


def _read(cells: pd.Series, *, day_first: bool = True) -> pd.DataFrame:
    """Return times of any supported format, NaT for other cells."""
    texts = cells.str.replace(_SPACES, " ", regex=True).str.strip()
    times = _digits(texts) if texts.iloc[0].isdigit() else _dated(texts, day_first)
    if times["wall"].dt.year.between(*YEARS).all() or not texts.str.fullmatch(_UNIX.pattern).all():
        return times
    counted = texts.str.removesuffix(".0")
    unit = "s" if len(counted.iloc[-1]) < 12 else "ms"
    wall = counted.astype("int64").to_numpy().astype(f"datetime64[{unit}]")
    return pd.DataFrame({"wall": wall, "offset_h": 0.0}, index=cells.index)


def _digits(texts: pd.Series) -> pd.DataFrame:
    """Read times of digits only: by their number, which must be the same everywhere."""
    length = len(texts.iloc[0])
    alike = texts.where(texts.str.fullmatch(rf"\d{{{length}}}") & (length in _DIGITS), "")
    wall = pd.to_datetime(alike, format=_DIGITS.get(length), errors="coerce")
    return pd.DataFrame({"wall": wall, "offset_h": np.nan})


def _dated(texts: pd.Series, day_first: bool) -> pd.DataFrame:
    """Read dates, each alone, with a time of day, or with a time of day and a UTC offset."""
    parts = texts.str.extract(rf"^{_TIME.pattern}$", flags=re.ASCII)
    dates, american = parts[0].fillna(""), bool(parts[4].notna().any())
    clock = parts[[1, 2, 3]].fillna("0").astype(float)
    hours = clock[1] % 12 + 12 * parts[4].str.lower().eq("p") if american else clock[1]
    possible = (clock[1] < 24) | (clock[1].eq(24) & clock[2].eq(0) & clock[3].eq(0) & (not american))
    possible &= (clock[2] < 60) & (clock[3] < 60)
    since = pd.to_timedelta(hours, unit="h") + pd.to_timedelta(60 * clock[2] + clock[3], unit="s")
    wall = (_days(texts, dates, american, day_first) + since).where(possible)
    offset_h = [_offset_h(*label) for label in parts[[5, 6, 7, 8]].itertuples(index=False, name=None)]
    return pd.DataFrame({"wall": wall, "offset_h": offset_h}, index=texts.index)


def _days(texts: pd.Series, dates: pd.Series, american: bool, day_first: bool) -> pd.Series:
    """Return the dates in the format that fits most; day or month comes first as gives the shorter period."""
    codes, days = pd.factorize(dates)
    readings = {form: pd.to_datetime(pd.Index(days), format=form, errors="coerce") for form in _DATES}
    best = max(readings, key=lambda form: int(readings[form].notna().sum()))
    first, other = readings[best], readings[_MONTH_FIRST]
    if best == _DAY_FIRST and not other.hasnans and not first.equals(other):
        spans = [reading.max() - reading.min() for reading in (first, other)]
        if spans[0] == spans[1] and not american and not day_first:
            fail(
                texts.index[0],
                f"{texts.iloc[0]!r} could be either day or month first; write times as 2024-01-31 14:00",
            )
        first = other if spans[1] < spans[0] or (spans[1] == spans[0] and american) else first
    return pd.Series(first.take(codes), texts.index)


def _offset_h(name: object, sign: object, hours: object, minutes: object) -> float:
    """Return the UTC offset of a time-zone label [h], NaN without a label."""
    if isinstance(name, str):
        return _NAMED[name]
    if not isinstance(sign, str):
        return np.nan
    return (int(str(hours)) + int(str(minutes)) / 60) * (-1 if sign == "-" else 1)


def _interleaved(rows: pd.DataFrame, times: pd.DataFrame, clock: tzinfo) -> pd.DataFrame:
    """Put the repeated hour in order where it was sorted by the clock (2:00, 2:00, 2:15, 2:15)."""
    wall = pd.DatetimeIndex(times["wall"])
    twice = np.flatnonzero(wall.tz_localize(clock, ambiguous="NaT", nonexistent="NaT").isna())
    order = np.arange(wall.size)
    order[twice] = twice[np.argsort(rows["utc"].to_numpy()[twice], kind="stable")]
    return rows.iloc[order]


def _check_order(rows: pd.DataFrame) -> None:
    if (line := first_line(rows["utc"].diff() <= pd.Timedelta(0))) is not None:
        utc = rows["utc"][line]
        before = rows["utc"].loc[:line].iloc[:-1]
        same = before[before == utc]
        when = f"{utc:%Y-%m-%d %H:%M} UTC"
        if same.size:
            fail(line, f"repeats {when} of line {same.index[0]}; remove one of the two rows")
        fail(line, f"goes back to {when}; sort the rows by ascending time")
