"""Cells to times: the formats of the exports, with or without an offset from UTC."""

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.market.files import fail

_DATES: Final = (
    "%Y-%m-%d",
    "%d.%m.%Y",
    "%d/%m/%Y",
    "%m/%d/%Y",
    "%b %d, %Y",
    "%Y/%m/%d",
    "%d.%m.%y",
    "%d-%m-%Y",
)
_DAY_FIRST: Final = "%d/%m/%Y"
_MONTH_FIRST: Final = "%m/%d/%Y"
_CLOCKS: Final = ("%H:%M", "%H:%M:%S", "%I:%M %p", "%I:%M:%S %p", "%H:%M:%S.%f")
_FORMATS: Final = ("%Y%m%d:%H%M", *(f"{d} {c}" for d in _DATES for c in _CLOCKS), *_DATES)
"""Formats tried in this order; the first that fits every cell is taken."""
_DIGITS: Final = {8: "%Y%m%d", 10: "%Y%m%d%H", 12: "%Y%m%d%H%M", 14: "%Y%m%d%H%M%S"}
"""Times of digits only, by their number: ``2024013112`` is 12:00, not 1:02."""

YEARS: Final = (1980, 2200)
"""Other years are numbers taken for times."""
_OFFSET: Final = re.compile(
    r"(.*\d:\d\d(?::\d\d(?:\.\d+)?)?)\s*(?:\(?(Z|UTC|GMT|CET|CEST)\)?|([+-])(\d\d):?(\d\d))"
)
_NAMED: Final = {"Z": 0.0, "UTC": 0.0, "GMT": 0.0, "CET": 1.0, "CEST": 2.0}
_ISO: Final = re.compile(r"(?:\d{4}-\d\d-\d\d[ T]\d\d:\d\d(?::\d\d)?\n)+", re.ASCII)
_LIKE_DATE: Final = re.compile(r"\d{1,4}[-./]\d{1,2}[-./]\d|\d{8}:\d{4}$|[A-Za-z]{3} \d")
_END_OF_DAY: Final = re.compile(r"^(.*\d) 24:00((?::00)?)$")
_SPACES: Final = re.compile(r"[\s\u00a0\u202f]+|(?<=\d)T(?=\d)|(?<=\d), (?=\d\d?:)")


@dataclass(frozen=True)
class Stamps:
    """Times as a file writes them.

    Attributes
    ----------
    wall : pandas.DatetimeIndex
        What the clock shows, without a zone.
    offset_h : numpy.ndarray
        Offset from UTC as labelled [h]; NaN where the cell has none.
    """

    wall: pd.DatetimeIndex
    offset_h: npt.NDArray[np.float64]

    @property
    def labelled(self) -> npt.NDArray[np.bool_]:
        """Which cells have an offset."""
        return ~np.isnan(self.offset_h)


def parse_stamps(
    path: str, name: str, cells: list[str], lines: list[int], *, day_first: bool = True
) -> Stamps:
    """Return the times of column `name`; raise InputError at the first cell that is none.

    Of ``03/04/2024`` the day comes first unless the other way the times lie closer together; without
    `day_first`, times that could be either are an error.
    """
    if quick := _quick(cells):
        return quick
    offset = np.full(len(cells), np.nan)
    texts = []
    for i, cell in enumerate(cells):
        match = _OFFSET.fullmatch(cell)
        if match:
            cell, offset[i] = match[1], _shift_h(match)
        texts.append(_SPACES.sub(" ", cell).strip())
    midnight = np.array([bool(_END_OF_DAY.search(text)) for text in texts])
    if midnight.any():
        texts = [_END_OF_DAY.sub(r"\1 00:00\2", text) for text in texts]
    wall = _parse_digits(texts) if texts[0].isdigit() else _parse(texts)
    if wall.isna().any() and (since := _unix(texts)) is not None:
        return Stamps(since, np.zeros(since.size))
    if not day_first and _could_be_either(texts):
        fail(
            path,
            lines[0],
            f"{cells[0]!r} could be either day or month first; write times as 2024-01-31 14:00",
        )
    wall += pd.to_timedelta(midnight.astype(int), unit="D")
    odd = np.asarray(wall.isna() | (wall.year < YEARS[0]) | (wall.year > YEARS[1]))
    if odd.any():
        bad = int(np.argmax(odd))
        fail(
            path,
            lines[bad],
            f"{cells[bad]!r} in column {name!r} is not a time like those around it; "
            "write 2024-01-31 14:00 or 31.01.2024 14:00, and check that columns are not swapped",
        )
    return Stamps(wall, offset)


def _quick(cells: list[str]) -> Stamps | None:
    """Return the times of a column that is ISO 8601 throughout, None if one of them needs a closer look."""
    match = _OFFSET.fullmatch(cells[0])
    end = "" if match is None else cells[0][match.end(1) :]
    together = "\n".join(cells) + "\n"
    if end:
        if together.count(f"{end}\n") != len(cells):
            return None
        together = together.replace(f"{end}\n", "\n")
    if together.count("\n") != len(cells) or not _ISO.fullmatch(together):
        return None
    try:
        wall = pd.DatetimeIndex(np.array(together.split("\n")[:-1], dtype="datetime64[s]"))
    except ValueError:
        return None
    if wall.year.min() < YEARS[0] or wall.year.max() > YEARS[1]:
        return None
    return Stamps(wall, np.full(wall.size, np.nan if match is None else _shift_h(match)))


def _shift_h(match: re.Match[str]) -> float:
    """Offset from UTC of a label [h]."""
    _, label, sign, hours, minutes = match.groups()
    return _NAMED[label] if label else (int(hours) + int(minutes) / 60) * (-1 if sign == "-" else 1)


def is_time(cell: str) -> bool:
    """Tell whether a cell begins with a time."""
    text = _SPACES.sub(" ", cell)[:16].strip()
    if not (text.isdigit() or _LIKE_DATE.match(text)):
        return False
    wall = _parse_digits([text]) if text.isdigit() else _parse([text])
    return bool(wall.notna()[0]) and YEARS[0] <= wall.year[0] <= YEARS[1]


def _parse_digits(texts: list[str]) -> pd.DatetimeIndex:
    """Read times of digits only: by their number, which must be the same everywhere."""
    length = len(texts[0])
    if length not in _DIGITS:
        return pd.DatetimeIndex([pd.NaT] * len(texts))
    alike = [text if len(text) == length and text.isdigit() else "" for text in texts]
    return pd.DatetimeIndex(pd.to_datetime(alike, format=_DIGITS[length], errors="coerce"))


def _unix(texts: list[str]) -> pd.DatetimeIndex | None:
    """Return times counted in seconds or milliseconds since 1970, None if that is not what they are."""
    unit = {10: "s", 13: "ms"}.get(len(texts[0]))
    if unit is None or not all(text.isdigit() and len(text) == len(texts[0]) for text in texts):
        return None
    return pd.DatetimeIndex(np.array(texts, dtype=np.int64).astype(f"datetime64[{unit}]"))


def _could_be_either(texts: list[str]) -> bool:
    """Tell whether all times are times with day and month exchanged as well, as close together."""
    day_first, month_first = (_read_with(texts, date) for date in (_DAY_FIRST, _MONTH_FIRST))
    return (
        day_first is not None
        and month_first is not None
        and _span(day_first) == _span(month_first)
        and not day_first.equals(month_first)
        and not texts[0].casefold().endswith("m")  # 2:00 pm is American
    )


def _read_with(texts: list[str], date: str) -> pd.DatetimeIndex | None:
    """Return all times read with a format of dates, or None if one does not fit."""
    for form in (*(f"{date} {clock}" for clock in _CLOCKS), date) if "/" in texts[0] else ():
        wall = pd.DatetimeIndex(pd.to_datetime(texts, format=form, errors="coerce"))
        if wall.notna().all():
            return wall
    return None


def _span(wall: pd.DatetimeIndex) -> pd.Timedelta:
    return wall.max() - wall.min()


def _parse(texts: list[str]) -> pd.DatetimeIndex:
    """Return the reading with the fewest cells left over, of equal ones the first, and the shorter period."""
    best = pd.DatetimeIndex([pd.NaT] * len(texts))
    fewest = len(texts) + 1
    for form in _FORMATS:
        if pd.isna(pd.to_datetime(texts[0], format=form, errors="coerce")) and fewest <= len(texts):
            continue
        wall = pd.DatetimeIndex(pd.to_datetime(texts, format=form, errors="coerce"))
        left = int(np.count_nonzero(wall.isna()))
        if left < fewest:
            best, fewest = wall, left
        if left == 0:
            other = _read_with(texts, _MONTH_FIRST) if _DAY_FIRST in form else None
            closer = other is not None and (_span(other), "%p" not in form) < (_span(wall), True)
            return other if other is not None and closer else wall
    return best
