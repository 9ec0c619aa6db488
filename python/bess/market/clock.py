"""What a clock shows to UTC: summer time resolved by the order of the rows."""

import re
from dataclasses import dataclass, replace
from datetime import timedelta, timezone, tzinfo
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.errors import InputError
from bess.market.files import fail
from bess.market.repairs import Repairs
from bess.market.stamps import Stamps

_FIXED: Final = re.compile(r"(?:UTC|GMT)?([+-])(\d{1,2})(?::?(\d\d))?", re.IGNORECASE)


@dataclass(frozen=True)
class Rows:
    """Values with their times in UTC, in the order of the file.

    Attributes
    ----------
    path : str
        For messages.
    utc : pandas.DatetimeIndex
        Start of each interval.
    values : numpy.ndarray
        NaN where missing.
    lines : numpy.ndarray
        Line of each row in the file.
    """

    path: str
    utc: pd.DatetimeIndex
    values: npt.NDArray[np.float64]
    lines: npt.NDArray[np.int64]

    def take(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> "Rows":
        """Return the rows `which`, a mask or positions."""
        return replace(self, utc=self.utc[which], values=self.values[which], lines=self.lines[which])


def clock_of(name: str) -> tzinfo:
    """Return the clock called `name`: an IANA zone or a fixed offset such as ``UTC+1``.

    Raises
    ------
    InputError
        There is no such time zone.
    """
    fixed = _FIXED.fullmatch(name.strip())
    if fixed:
        sign, hours, minutes = fixed.groups()
        shift = timedelta(hours=int(hours), minutes=int(minutes or 0))
        if shift < timedelta(hours=24):
            return timezone(-shift if sign == "-" else shift)
    try:
        return ZoneInfo(name.strip())
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise InputError(
            f"time_zone {name!r} is unknown; give a name such as Europe/Berlin, UTC or UTC+1"
        ) from None


def localise(wall: pd.DatetimeIndex, clock: tzinfo) -> pd.DatetimeIndex:
    """Return UTC: of two equal times the first is summer time; NaT for those that summer time skips."""
    first = ~wall.duplicated(keep="first")
    return wall.tz_localize(clock, ambiguous=first, nonexistent="NaT").tz_convert("UTC")


def skipped(wall: pd.DatetimeIndex, clock: tzinfo) -> npt.NDArray[np.bool_]:
    """Tell which times do not exist on `clock`, in the hour that summer time skips."""
    everything = np.ones(wall.size, dtype=bool)
    return np.asarray(wall.tz_localize(clock, ambiguous=everything, nonexistent="NaT").isna())


def to_utc(
    path: str,
    stamps: Stamps,
    values: npt.NDArray[np.float64],
    lines: list[int],
    clock: tzinfo,
    repairs: Repairs,
    *,
    drop_skipped: bool = True,
) -> Rows:
    """Place the rows of a file in UTC; a label in a cell goes before the clock.

    Rows in the hour that summer time skips are dropped if `drop_skipped` (exports, whose clock is known) or
    if they are empty; otherwise they are an error, since the clock is then probably another one.
    """
    utc = localise(stamps.wall, clock)
    labelled = stamps.labelled
    if labelled.any():
        utc = pd.DatetimeIndex(np.where(labelled, by_label(stamps), utc.tz_localize(None))).tz_localize("UTC")
    rows = Rows(path, utc, values, np.asarray(lines, dtype=np.int64))
    gone = np.asarray(utc.isna())
    if gone.any():
        wrong = gone & ~np.isnan(values)
        if wrong.any() and not drop_skipped:
            first = int(np.argmax(wrong))
            fail(
                path,
                lines[first],
                f"{stamps.wall[first]:%Y-%m-%d %H:%M} does not exist in {clock}; "
                "if the clock of the file has no summer time, give time_zone='UTC+1' or its own offset",
            )
        repairs.add(
            "spring-hour", "dropped the hour that summer time skips", gone.sum(), lines[int(np.argmax(gone))]
        )
        rows = rows.take(~gone)
    again = stamps.wall.duplicated(keep="first") & ~labelled & ~gone
    if again.any():
        text = "took the repeated hour of autumn in the order of the file"
        repairs.add("autumn-hour", text, again.sum(), lines[int(np.argmax(again))])
        rows = _interleaved(rows, stamps.wall[~gone], clock)
    _check_order(rows)
    return rows


def ends_day(utc: pd.DatetimeIndex, clock: tzinfo) -> bool:
    """Tell whether the last row ends a whole day; the step is that of the last two rows."""
    if utc.size < 2:
        return True
    end = (utc[-1] + (utc[-1] - utc[-2])).tz_convert(clock)
    return bool(end == end.normalize())


def by_label(stamps: Stamps) -> npt.NDArray[np.datetime64]:
    """Return UTC as the offsets in the cells say; NaT where there is none."""
    return np.asarray(stamps.wall - pd.to_timedelta(stamps.offset_h, unit="h"))


def _interleaved(rows: Rows, wall: pd.DatetimeIndex, clock: tzinfo) -> Rows:
    """Put the repeated hour in order where it was sorted by the clock (2:00, 2:00, 2:15, 2:15)."""
    twice = np.flatnonzero(wall.tz_localize(clock, ambiguous="NaT", nonexistent="NaT").isna())
    order = np.arange(wall.size)
    order[twice] = twice[np.argsort(rows.utc[twice], kind="stable")]
    return rows.take(order)


def _check_order(rows: Rows) -> None:
    back = rows.utc[1:] <= rows.utc[:-1]
    if back.any():
        i = int(np.argmax(back)) + 1
        same = np.flatnonzero(rows.utc[:i] == rows.utc[i])
        when = f"{rows.utc[i]:%Y-%m-%d %H:%M} UTC"
        if same.size:
            first = rows.lines[same[0]]
            fail(rows.path, int(rows.lines[i]), f"repeats {when} of line {first}; remove one of the two rows")
        fail(rows.path, int(rows.lines[i]), f"goes back to {when}; sort the rows by ascending time")
