"""Text cells to numbers: decimal comma or point, thousands separators, codes for missing values."""

import re
from typing import Final, Literal

import numpy as np
import pandas as pd

from bess.market.files import fail, first_line

MISSING: Final = frozenset(
    {"", "-", "–", "—", "--", "n/e", "n/a", "na", "nan", "null", "none", "nil", "#n/a", "\\n"}
)
"""Codes of missing values, in lower case."""

_MAX_VALUE: Final = 1e12
_CLEAN: Final = str.maketrans(
    {"\u2212": "-", "\u00a0": None, "\u202f": None, " ": None, "'": None, "\n": None}
)
_DECIMALS: Final = {sign: re.compile(rf"[{sign}](?:\d{{1,2}}|\d{{4,}})(?:e|$)") for sign in ",."}
_NUMBERS: Final = {
    ",": re.compile(r"[+-]?(?=[.,]?\d)(\d{1,3}(\.\d{3})+|\d*)(,\d*)?(e[+-]?\d+)?", re.ASCII),
    ".": re.compile(r"[+-]?(?=[.,]?\d)(\d{1,3}(,\d{3})+|\d*)(\.\d*)?(e[+-]?\d+)?", re.ASCII),
}
_NAMES: Final = {",": "comma", ".": "point"}


def parse_numbers(cells: pd.Series, default: Literal[",", "."] = ".") -> pd.Series:
    """Return the numbers of a column by line, NaN where a value is missing.

    The decimal sign is detected from the whole column; `default` applies if it is ambiguous (``1.234``).
    """
    texts = [cell.translate(_CLEAN).lower() for cell in cells]
    decimal = _decimal(cells, texts) or default
    thousands = "." if decimal == "," else ","
    number = _NUMBERS[decimal].fullmatch
    values = np.full(len(texts), np.nan)
    for i, text in enumerate(texts):
        if number(text):
            values[i] = float(text.replace(thousands, "").replace(decimal, "."))
        elif text not in MISSING:
            fail(
                cells.index[i],
                f"{cells.iloc[i]!r} in column {cells.name!r} is not a number with decimal {_NAMES[decimal]}; "
                "check that columns are not swapped and the separator is right",
            )
    return check_size(pd.Series(values, cells.index, name=cells.name))


def check_size(values: pd.Series) -> pd.Series:
    """Raise InputError for infinite values and values out of range for any price, power or temperature."""
    if (line := first_line(values.abs() > _MAX_VALUE)) is not None:
        text = f"{values[line]:g} in column {values.name!r} is beyond {_MAX_VALUE:g}; correct the number"
        fail(line, text)
    return values


def _decimal(cells: pd.Series, texts: list[str]) -> str | None:
    """Return the decimal separator if the column determines it."""
    first = {}
    for sign, pattern in _DECIMALS.items():
        first[sign] = next((i for i, text in enumerate(texts) if sign in text and pattern.search(text)), None)
    comma, point = first[","], first["."]
    if comma is not None and point is not None:
        fail(
            cells.index[max(comma, point)],
            f"column {cells.name!r} has a decimal comma in line {cells.index[comma]} and a decimal point in "
            f"line {cells.index[point]}; write all numbers alike",
        )
    return "," if comma is not None else "." if point is not None else None
