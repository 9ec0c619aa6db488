"""Plain files, CSV or Parquet: one or two columns of time, and columns of numbers by name."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.extras import extra
from bess.market.clock import Rows, clock_of, ends_day, to_utc
from bess.market.files import fail, listed
from bess.market.numbers import check_size, parse_numbers
from bess.market.repairs import Repairs
from bess.market.sources import read_table
from bess.market.stamps import YEARS, Stamps, is_time, parse_stamps
from bess.market.table import Ending, Table

_CLOCK_CELL: Final = re.compile(r"\d{1,2}:\d\d(:\d\d)?")
_UNIT: Final = re.compile(r"\s*[\[(].*?[\])]")
_NAMED_CLOCK: Final = re.compile(
    r"\((UTC|GMT|CET/CEST|CET|WET/WEST|WET|EET/EEST|EET)\)|(?:hour|time|date_?time|datetime_?)_?(utc)\b",
    re.IGNORECASE,
)
CLOCKS: Final = {
    "UTC": "UTC",
    "GMT": "UTC",
    "WET": "Europe/Lisbon",
    "WET/WEST": "Europe/Lisbon",
    "EET": "Europe/Helsinki",
    "EET/EEST": "Europe/Helsinki",
}
"""Clocks by their names in titles; CET and CET/CEST both mean the clock of Brussels."""
_OFFSETS: Final = (("utc_offset_seconds", 1), ("time zone", 3600))
"""Offsets from UTC in the block above a table: of Open-Meteo, and of the NSRDB."""
_NUMBER: Final = re.compile(r"-?\d+(\.\d+)?")


@dataclass(frozen=True)
class Columns:
    """A file of times and named columns.

    Attributes
    ----------
    path : str
    stamps : Stamps
    lines : list of int
        Line (CSV) or row (Parquet) of each time, from 1.
    names : list of str
        The columns that are not times.
    values : callable
        From a name to its numbers, NaN where missing.
    clock : str or None
        Clock that the title of the times names.
    typical : bool
        The hours of a typical year.
    last : str or None
        The column in which the file ends, if that can have been cut off.
    ending : Ending
        How the file ends in it.
    """

    path: str
    stamps: Stamps
    lines: list[int]
    names: list[str]
    values: Callable[[str], npt.NDArray[np.float64]]
    clock: str | None = None
    typical: bool = False
    last: str | None = None
    ending: Ending = Ending.CLEAN

    def choose(self, wanted: str | None, what: str) -> str:
        """Return the column called `wanted`, or the only one; raise InputError, listing them, otherwise."""
        if wanted is not None:
            for plain in (str.casefold, lambda name: _UNIT.sub("", name).casefold()):
                for name in self.names:
                    if plain(name) == wanted.casefold():
                        return name
        elif len(self.names) == 1:
            return self.names[0]
        problem = (
            f"there is no column {wanted!r}"
            if wanted is not None
            else f"which column is the {what} is not clear"
        )
        fail(self.path, 1, f"{problem}; give one of: {listed(self.names)}")

    def labelled_at_start(self, repairs: Repairs) -> "Columns":
        """Return the columns with times that label the end of each interval moved to its start.

        Such are whole days of which the first begins a step after midnight and the last ends at midnight.
        """
        wall = self.stamps.wall
        if wall.size < 2:
            return self
        step = wall[1] - wall[0]
        first, last = (wall[i] - wall[i].normalize() for i in (0, -1))
        if not (first == step and last == pd.Timedelta(0) and step <= pd.Timedelta(hours=1)):
            return self
        text = "moved times that label the end of their interval to its start"
        repairs.add("end-labels", text, wall.size, self.lines[0])
        return replace(self, stamps=Stamps(wall - step, self.stamps.offset_h))

    def rows(self, name: str, time_zone: str | None, repairs: Repairs) -> Rows:
        """Return the numbers of one column in UTC; times need an offset in the file or a `time_zone`."""
        labelled = self.stamps.labelled
        time_zone = time_zone or self.clock
        if labelled.all():
            self._check_offsets()
            clock: tzinfo = UTC
        elif labelled.any():
            odd = int(np.argmax(labelled != labelled[0]))
            has, other = ("has no", "has one") if labelled[0] else ("has a", "has none")
            fail(
                self.path,
                self.lines[odd],
                f"the time {has} UTC offset while line {self.lines[0]} {other}: mixed time zones; "
                "write all times alike",
            )
        elif time_zone is None:
            fail(
                self.path,
                self.lines[0],
                f"the time {self.stamps.wall[0]:%Y-%m-%d %H:%M} has no time zone; give time_zone, such as "
                "'UTC' or 'Europe/Berlin'",
            )
        else:
            clock = clock_of(time_zone)
        values = self.values(name)
        rows = to_utc(self.path, self.stamps, values, self.lines, clock, repairs, drop_skipped=False)
        if name == self.last:
            self._check_end(rows, clock)
        return rows

    def _check_end(self, rows: Rows, clock: tzinfo) -> None:
        """Refuse a file that may have been cut off in its last number."""
        part = self.ending is Ending.OPEN and not (ends_day(rows.utc, clock) or ends_day(rows.utc, UTC))
        if part or self.ending is Ending.CUT:
            fail(
                self.path,
                self.lines[-1],
                f"the file ends {self.ending.value}, so it may be truncated; fetch it again, or end its last "
                "line with a line break if it is complete",
            )

    def _check_offsets(self) -> None:
        """Offsets may differ by the hour of summer time, not more."""
        offset = self.stamps.offset_h
        far = np.abs(offset - offset[0]) > 1.0
        if far.any():
            i = int(np.argmax(far))
            fail(
                self.path,
                self.lines[i],
                f"the time is {offset[i]:+g} h from UTC while line {self.lines[0]} is {offset[0]:+g} h: "
                "mixed time zones; write all times in one zone",
            )


def read_columns(path: str, raw: bytes, repairs: Repairs) -> Columns:
    """Read a plain CSV or Parquet file."""
    return _parquet(path, raw) if raw[:4] == b"PAR1" else csv_columns(read_table(path, raw, repairs))


def csv_columns(table: Table) -> Columns:
    """Find the times in a table, and parse them."""
    used, cells = _time_cells(table)
    label = " + ".join(table.header[i] for i in used)
    if all(" - " in cell for cell in cells):
        cells = [cell.partition(" - ")[0].strip() for cell in cells]
    stamps = parse_stamps(table.path, label, cells, table.lines, day_first=False)
    first = table.rows[0]
    others = [i for i in range(len(table.header)) if i not in used and not _is_clock(first[i].strip())]
    index = {table.header[i] or f"column {i + 1}": i for i in others}
    if len(index) != len(others):
        fail(table.path, 1, f"two columns have the same name; name them apart: {listed(table.header)}")
    default: Literal[",", "."] = "," if table.separator != "," and not _has_points(table, others) else "."

    def values(name: str) -> npt.NDArray[np.float64]:
        return parse_numbers(table.path, name, table.column(index[name]), table.lines, default)

    last = next((name for name, i in index.items() if i == len(table.rows[-1]) - 1), None)
    clock = _clock_in(label, table.preamble)
    names = list(index)
    return Columns(table.path, stamps, table.lines, names, values, clock, table.typical, last, table.ending)


def _is_clock(cell: str) -> bool:
    """Tell whether a cell is a time, as of a second column of times; a number is none."""
    return not cell.isdigit() and is_time(cell.partition(" - ")[0])


def _clock_in(label: str, preamble: list[list[str]]) -> str | None:
    """Return the clock that the title of the times names, or the block above the header."""
    named = _NAMED_CLOCK.search(label)
    if named:
        return CLOCKS.get((named[1] or named[2]).upper(), "Europe/Brussels")
    for names, values in pairwise(preamble):
        said = {name.strip().casefold(): value.strip() for name, value in zip(names, values, strict=False)}
        for key, unit_s in _OFFSETS:
            if _NUMBER.fullmatch(said.get(key, "")):
                seconds = round(float(said[key]) * unit_s)
                sign, minutes = "-" if seconds < 0 else "+", abs(seconds) // 60
                return f"UTC{sign}{minutes // 60:02d}:{minutes % 60:02d}"
    return None


def _has_points(table: Table, columns: list[int]) -> bool:
    return any("." in row[i] and "," not in row[i] for row in table.rows for i in columns)


def _time_cells(table: Table) -> tuple[list[int], list[str]]:
    """Return the columns that hold the time, and one text for each row."""
    parts = [table.named(name) for name in ("year", "month", "day", "hour")]
    if None not in parts:
        minute = table.named("minute")
        used = [i for i in (*parts, minute) if i is not None]
        texts = [[row[i].strip().zfill(2) for i in used] for row in table.rows]
        return used, [f"{t[0]}-{t[1]}-{t[2]} {t[3]}:{t[4] if minute is not None else '00'}" for t in texts]
    in_utc = (
        i for i, name in enumerate(table.header) if "utc" in name.casefold() and is_time(table.rows[0][i])
    )
    first = table.named("MESS_DATUM") or next(in_utc, 0)
    cells = table.column(first)
    if first == 0 and len(table.header) > 1:
        second = table.column(first + 1)
        if _CLOCK_CELL.fullmatch(second[0]) and ":" not in cells[0]:
            return [first, first + 1], [f"{day} {clock}" for day, clock in zip(cells, second, strict=True)]
        if not is_time(cells[0]) and is_time(second[0]) and cells[0][:1].isalpha():
            return [first + 1], second
        if not is_time(cells[0]) and is_time(second[0]):
            fail(
                table.path,
                table.lines[0],
                f"columns {table.header[0]!r} and {table.header[1]!r} are swapped: put the time first",
            )
    return [first], cells


def _parquet(path: str, raw: bytes) -> Columns:
    with extra("market", f"{path}: a Parquet file"):
        try:
            frame = pd.read_parquet(io.BytesIO(raw))
        except ImportError:
            raise
        except Exception as error:  # pyarrow and pandas raise most of what there is for damaged bytes
            what = (str(error).splitlines() or [""])[0] or type(error).__name__
            fail(path, None, f"the Parquet file is damaged or truncated ({what}); fetch it again")
    if not isinstance(frame.index, pd.DatetimeIndex):
        times = [
            c
            for c in frame.columns
            if isinstance(frame[c].dtype, pd.DatetimeTZDtype) or frame[c].dtype.kind == "M"
        ]
        if not times:
            fail(
                path,
                None,
                f"no column of times among {listed(map(str, frame.columns))}; store one as a timestamp",
            )
        frame = frame.set_index(times[0])
    index = pd.DatetimeIndex(frame.index)
    if index.size == 0:
        fail(path, None, "the Parquet file holds no rows; fetch it again")
    if index.hasnans:
        fail(path, int(np.argmax(index.isna())) + 1, "has no time; remove the row")
    odd = (index.year < YEARS[0]) | (index.year > YEARS[1])
    if odd.any():
        row = int(np.argmax(odd))
        fail(
            path,
            row + 1,
            f"has a time of the year {index.year[row]}, must be {YEARS[0]} to {YEARS[1]}; correct the row",
        )
    aware = index.tz is not None
    stamps = Stamps(
        index.tz_convert("UTC").tz_localize(None) if aware else index,
        np.full(index.size, 0.0 if aware else np.nan),
    )
    frame.columns = frame.columns.map(str)
    if not frame.columns.is_unique:
        fail(path, None, f"two columns have the same name; name them apart: {listed(frame.columns)}")
    names = [c for c in frame.columns if frame[c].dtype.kind in "iuf"]

    def values(name: str) -> npt.NDArray[np.float64]:
        numbers = frame[name].to_numpy(dtype=np.float64, na_value=np.nan)
        for row in np.flatnonzero(np.abs(numbers) > 1e12)[:1]:
            check_size(path, name, float(numbers[row]), int(row) + 1)
        return numbers

    return Columns(path, stamps, list(range(1, index.size + 1)), names, values)
