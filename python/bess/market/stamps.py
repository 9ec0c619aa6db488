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
_CLOCKS: Final = ("%H:%M", "%H:%M:%S", "%I:%M %p", "%I:%M:%S %p", "%H:%M:%S.%f")
FORMATS: Final = (*(f"{d} {c}" for d in _DATES for c in _CLOCKS), "%Y%m%d%H%M", "%Y%m%d%H", *_DATES)
"""Formats tried in this order; the first that fits every cell is taken."""

_YEARS: Final = (1980, 2200)
"""Other years are numbers taken for times."""
_OFFSET: Final = re.compile(
    r"(.*\d:\d\d(?::\d\d(?:\.\d+)?)?)\s*(?:\(?(Z|UTC|GMT|CET|CEST)\)?|([+-])(\d\d):?(\d\d))"
)
_NAMED: Final = {"Z": 0.0, "UTC": 0.0, "GMT": 0.0, "CET": 1.0, "CEST": 2.0}
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


def parse_stamps(path: str, name: str, cells: list[str], lines: list[int]) -> Stamps:
    """Return the times of column `name`; raise InputError at the first cell that is none."""
    offset = np.full(len(cells), np.nan)
    texts = []
    for i, cell in enumerate(cells):
        match = _OFFSET.fullmatch(cell)
        if match:
            cell, label, sign, hours, minutes = match.groups()
            shift = _NAMED[label] if label else (int(hours) + int(minutes) / 60) * (-1 if sign == "-" else 1)
            offset[i] = shift
        texts.append(_SPACES.sub(" ", cell).strip())
    wall = _parse(texts)
    odd = np.asarray(wall.isna() | (wall.year < _YEARS[0]) | (wall.year > _YEARS[1]))
    if odd.any():
        bad = int(np.argmax(odd))
        fail(
            path,
            lines[bad],
            f"{cells[bad]!r} in column {name!r} is not a time like those around it; "
            "write 2024-01-31 14:00 or 31.01.2024 14:00, and check that columns are not swapped",
        )
    return Stamps(wall, offset)


def _parse(texts: list[str]) -> pd.DatetimeIndex:
    """Return the reading with the fewest cells left over, the first of equal ones."""
    best = pd.DatetimeIndex([pd.NaT] * len(texts))
    fewest = len(texts) + 1
    for form in FORMATS:
        if pd.isna(pd.to_datetime(texts[0], format=form, errors="coerce")) and fewest <= len(texts):
            continue
        wall = pd.DatetimeIndex(pd.to_datetime(texts, format=form, errors="coerce"))
        left = int(np.count_nonzero(wall.isna()))
        if left < fewest:
            best, fewest = wall, left
        if left == 0:
            break
    return best
