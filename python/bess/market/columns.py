"""Plain CSV and Parquet files: one or two time columns and named numeric columns."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import pandas as pd

from bess.errors import listed
from bess.market.files import Repairs, fail, first_line
from bess.market.layouts import offset_label
from bess.market.numbers import check_size, parse_numbers
from bess.market.table import Ending, Table, read_table
from bess.market.times import YEARS, clock_of, ends_day, have_offsets, in_utc, is_time, parse_times, to_utc
from bess.optional_dependencies import extra
from bess.units import SECONDS_PER_HOUR

_CLOCK_CELL: Final = re.compile(r"\d{1,2}:\d\d(:\d\d)?")
_UNIT: Final = re.compile(r"\s*[\[(].*?[\])]")
_NAMED_CLOCK: Final = re.compile(
    r"\((UTC|GMT|CET/CEST|CET|WET/WEST|WET|EET/EEST|EET)\)|(?:hour|time|date_?time|datetime_?)_?(utc)\b",
    re.IGNORECASE,
)
_CLOCKS: Final = {"UTC": "UTC", "GMT": "UTC", "WET": "Europe/Lisbon", "EET": "Europe/Helsinki"}
_BRUSSELS: Final = "Europe/Brussels"
"""Clock of both ``CET`` and ``CET/CEST``."""
_OFFSETS: Final = (("utc_offset_seconds", 1.0), ("time zone", SECONDS_PER_HOUR))
"""Offsets from UTC in the block above a table: of Open-Meteo, and of the NSRDB."""
_NUMBER: Final = re.compile(r"-?\d+(\.\d+)?")


@dataclass(frozen=True)
class Columns:
    """Time stamps and named numeric columns of a file."""

    times: pd.DataFrame
    """Times by line (CSV) or row (Parquet), from 1; see :mod:`bess.market.times`."""
    names: list[str]
    """Names of the numeric columns."""
    values: Callable[[str], pd.Series]
    """Function from a name to its values, NaN where missing."""
    clock: str | None = None
    """Time zone named in the file."""
    typical: bool = False
    """The hours of a typical year."""
    last: str | None = None
    """The column in which the file ends."""
    ending: Ending = Ending.CLEAN
    """How it ends there."""

    def choose(self, wanted: str | None, what: str) -> str:
        """Return the column called `wanted`, or the only one; raise InputError, listing them, otherwise."""
        if wanted is None:
            found = self.names if len(self.names) == 1 else []
            problem = f"which column is the {what} is not clear"
        else:
            key, names = str(wanted).casefold(), self.names
            found = [name for name in names if name.casefold() == key]
            found += [name for name in names if without_unit(name).casefold() == key]
            problem = f"there is no column {wanted!r}"
        if not found:
            fail(1, f"{problem}; give one of: {listed(self.names)}")
        return found[0]

    def at(self, wall: pd.Series) -> "Columns":
        """Return the same columns with other wall-clock times."""
        return replace(self, times=self.times.assign(wall=wall))

    def _end_labels(self, repairs: Repairs) -> pd.Timedelta | None:
        """Return the step if times label the end of each interval: from a step after midnight to midnight."""
        wall = self.times["wall"]
        if wall.size < 2:
            return None
        step = pd.Timedelta(wall.iloc[1] - wall.iloc[0])
        first, last = (wall.iloc[i] - wall.iloc[i].normalize() for i in (0, -1))
        if not (first == step and last == pd.Timedelta(0) and step <= pd.Timedelta(hours=1)):
            return None
        text = "moved times that label the end of their interval to its start"
        repairs.add("end-labels", text, wall.size, wall.index[0])
        return step

    def rows(
        self, name: str, time_zone: str | None, repairs: Repairs, *, may_label_ends: bool = False
    ) -> pd.DataFrame:
        """Return the numbers of one column in UTC; times need an offset in the file or a `time_zone`.

        Times that label the end of each interval, if they may, are moved to its start.
        """
        clock = self._clock(time_zone)
        step = self._end_labels(repairs) if may_label_ends else None
        if step is not None and not _ascends(in_utc(self.times, clock)):
            # The clock at the start of the interval and a step, even where the clock changes in it.
            return self.at(self.times["wall"] - step).rows(name, time_zone, repairs)
        rows = to_utc(self.times, self.values(name), clock, repairs, drop_skipped=False)
        if step is not None:
            rows["utc"] -= step
        whole = ends_day(rows["utc"], clock) or ends_day(rows["utc"], UTC)
        if name == self.last and (self.ending is Ending.CUT or (self.ending is Ending.OPEN and not whole)):
            refuse_end(self.times.index[-1], self.ending)
        return rows

    def _clock(self, time_zone: str | None) -> tzinfo:
        """Return the clock of the times: UTC where they have offsets, which then must be alike."""
        lines, offset_h = self.times.index, self.times["offset_h"]
        if have_offsets(self.times):
            # Offsets differ by the hour of summer time at most.
            if (line := first_line((offset_h - offset_h.iloc[0]).abs() > 1.0)) is not None:
                fail(
                    line,
                    f"the time is {offset_h[line]:+g} h from UTC while line {lines[0]} is "
                    f"{offset_h.iloc[0]:+g} h: mixed time zones; write all times in one zone",
                )
            return UTC
        if name := time_zone or self.clock:
            return clock_of(name)
        fail(
            lines[0],
            f"the time {self.times['wall'].iloc[0]:%Y-%m-%d %H:%M} has no time zone; give time_zone, "
            "such as 'UTC' or 'Europe/Berlin'",
        )


def _ascends(utc: pd.DatetimeIndex) -> bool:
    return not utc.hasnans and utc.is_monotonic_increasing and utc.is_unique


def without_unit(name: str) -> str:
    """Return a column name without its part in brackets."""
    return _UNIT.sub("", name)


def refuse_end(line: int, ending: Ending) -> None:
    """Raise InputError if the last number of a file may be truncated."""
    fail(
        line,
        f"the file ends {ending.value}, so it may be truncated; fetch it again, or end its last line with a "
        "line break if it is complete",
    )


def read_columns(raw: bytes, repairs: Repairs) -> Columns:
    """Read a plain CSV or Parquet file."""
    return parquet_columns(raw) if raw[:4] == b"PAR1" else table_columns(read_table(raw, repairs))


def table_columns(table: Table) -> Columns:
    """Find and parse the time columns of a table."""
    used, cells = _time_cells(table)
    times = parse_times(cells, day_first=False)
    first = table.rows[0]
    others = [i for i in range(len(table.header)) if i not in used and not _is_clock(first[i].strip())]
    index = {table.header[i] or f"column {i + 1}": i for i in others}
    if len(index) != len(others):
        fail(1, f"two columns have the same name; name them apart: {listed(table.header)}")
    has_points = any("." in row[i] and "," not in row[i] for row in table.rows for i in others)
    default: Literal[",", "."] = "," if table.separator != "," and not has_points else "."
    last = next((name for name, i in index.items() if i == len(table.rows[-1]) - 1), None)
    return Columns(
        times,
        list(index),
        lambda name: parse_numbers(table.column(index[name]).rename(name), default),
        named_clock(str(cells.name)) or _clock_above(table.preamble),
        table.typical,
        last,
        table.ending,
    )


def named_clock(label: str) -> str | None:
    """Return the time zone named in the title of the time column."""
    named = _NAMED_CLOCK.search(label)
    if named is None:
        return None
    return _CLOCKS.get((named[1] or named[2]).upper().partition("/")[0], _BRUSSELS)


def _clock_above(preamble: list[list[str]]) -> str | None:
    """Return the UTC offset given above a table."""
    for names, values in pairwise(preamble):
        offsets = {name.casefold(): value for name, value in zip(names, values, strict=False)}
        for key, unit_s in _OFFSETS:
            if _NUMBER.fullmatch(offsets.get(key, "")):
                return f"UTC{offset_label(float(offsets[key]) * unit_s)}"
    return None


def _is_clock(cell: str) -> bool:
    """Return whether a cell holds a time of day or a time stamp; a plain number does not count."""
    return not cell.isdigit() and is_time(cell)


def _time_cells(table: Table) -> tuple[list[int], pd.Series]:
    """Return the indices of the time columns, and the time of each row as text."""
    parts = [i for name in ("year", "month", "day", "hour") if (i := table.named(name)) is not None]
    if len(parts) == 4:
        minute = table.named("minute")
        year, month, day, hour = (table.column(i).str.zfill(2) for i in parts)
        clock = "00" if minute is None else table.column(minute).str.zfill(2)
        times = year + "-" + month + "-" + day + " " + hour + ":" + clock
        return [*parts, *([] if minute is None else [minute])], times.rename("year + month + day + hour")
    in_utc = (
        i for i, name in enumerate(table.header) if "utc" in name.casefold() and is_time(table.rows[0][i])
    )
    first = table.named("MESS_DATUM")
    first = next(in_utc, 0) if first is None else first
    cells = table.column(first)
    if first == 0 and len(table.header) > 1:
        second = table.column(1)
        day, clock = cells.iloc[0], second.iloc[0]
        if _CLOCK_CELL.fullmatch(clock) and ":" not in day:
            return [0, 1], (cells + " " + second).rename(f"{table.header[0]} + {table.header[1]}")
        if not is_time(day) and is_time(clock):
            if not day[:1].isalpha():
                names = f"{table.header[0]!r} and {table.header[1]!r}"
                fail(table.lines[0], f"columns {names} are swapped: put the time first")
            first, cells = 1, second
    if cells.str.contains(" - ", regex=False).all():
        cells = cells.str.partition(" - ")[0].str.strip().rename(table.header[first])
    return [first], cells


def parquet_columns(raw: bytes) -> Columns:
    """Read a Parquet file with a time index or a time column."""
    with extra("market", "a Parquet file"):
        try:
            frame = pd.read_parquet(io.BytesIO(raw))
        except ImportError:
            raise
        except Exception as error:  # damaged bytes raise almost any exception in pyarrow and pandas
            what = (str(error).splitlines() or [""])[0] or type(error).__name__
            fail(None, f"the Parquet file is damaged or truncated ({what}); fetch it again")
    if not isinstance(frame.index, pd.DatetimeIndex):
        times = frame.select_dtypes(["datetime", "datetimetz"]).columns
        if times.empty:
            there = listed(map(str, frame.columns))
            fail(None, f"no column of times among {there}; store one as a timestamp")
        frame = frame.set_index(times[0])
    index = pd.DatetimeIndex(frame.index)
    if index.size == 0:
        fail(None, "the Parquet file holds no rows; fetch it again")
    lines = pd.RangeIndex(1, index.size + 1)
    years = pd.Series(index.year, lines)
    if (row := first_line(~years.between(*YEARS))) is not None:
        found = "no time" if pd.isna(years[row]) else f"a time of the year {years[row]:g}"
        fail(row, f"has {found}, must be {YEARS[0]} to {YEARS[1]}; correct or remove the row")
    aware = index.tz is not None
    wall = index.tz_convert("UTC").tz_localize(None) if aware else index
    frame.columns = frame.columns.map(str)
    if not frame.columns.is_unique:
        fail(None, f"two columns have the same name; name them apart: {listed(frame.columns)}")

    def values(name: str) -> pd.Series:
        return check_size(pd.Series(frame[name].to_numpy(np.float64, na_value=np.nan), lines, name=name))

    stamps = pd.DataFrame({"wall": wall, "offset_h": 0.0 if aware else np.nan}, index=lines)
    return Columns(stamps, [c for c in frame.columns if frame[c].dtype.kind in "iuf"], values)
