"""Cells to numbers: decimal comma or point, thousands, signs for missing values."""

import re
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from bess.market.files import fail

MISSING: Final = frozenset(
    {"", "-", "–", "—", "--", "n/e", "n/a", "na", "nan", "null", "none", "nil", "#n/a", "\\n"}
)
"""What stands for a missing value, in lower case."""

_LARGEST: Final = 1e12
_CLEAN: Final = str.maketrans({"\u2212": "-", "\u00a0": None, "\u202f": None, " ": None, "'": None})
_DECIMALS: Final = {",": re.compile(r",(\d{1,2}|\d{4,})(e|$)"), ".": re.compile(r"\.(\d{1,2}|\d{4,})(e|$)")}
_NUMBER: Final = {
    ",": re.compile(r"[+-]?(\d{1,3}(\.\d{3})+|\d*)(,\d*)?(e[+-]?\d+)?"),
    ".": re.compile(r"[+-]?(\d{1,3}(,\d{3})+|\d*)(\.\d*)?(e[+-]?\d+)?"),
}


def parse_numbers(
    path: str, name: str, cells: list[str], lines: list[int], default: Literal[",", "."] = "."
) -> npt.NDArray[np.float64]:
    """Return the numbers of column `name`, NaN where a value is missing.

    The decimal sign is found from the whole column; `default` decides where nothing tells (``1.234``).
    """
    texts = [cell.translate(_CLEAN).lower() for cell in cells]
    decimal = _decimal(path, name, texts, lines, default)
    thousands = "." if decimal == "," else ","
    pattern = _NUMBER[decimal]
    values = np.empty(len(texts))
    for i, text in enumerate(texts):
        if text in MISSING:
            values[i] = np.nan
        elif pattern.fullmatch(text) and any(map(str.isdigit, text)):
            values[i] = float(text.replace(thousands, "").replace(decimal, "."))
            check_size(path, name, values[i], lines[i])
        else:
            fail(
                path,
                lines[i],
                f"{cells[i]!r} in column {name!r} is not a number with decimal {_NAMES[decimal]}; "
                "check that columns are not swapped and the separator is right",
            )
    return values


def check_size(path: str, name: str, value: float, line: int) -> None:
    """Raise InputError for a number that no price, power or temperature has; infinity among them."""
    if abs(value) > _LARGEST:
        fail(path, line, f"{value:g} in column {name!r} is beyond {_LARGEST:g}; correct the number")


_NAMES: Final = {",": "comma", ".": "point"}


def _decimal(path: str, name: str, texts: list[str], lines: list[int], default: str) -> str:
    first = {
        sign: next((i for i, t in enumerate(texts) if p.search(t)), None) for sign, p in _DECIMALS.items()
    }
    comma, point = first[","], first["."]
    if comma is not None and point is not None:
        fail(
            path,
            lines[max(comma, point)],
            f"column {name!r} has a decimal comma in line {lines[comma]} and a decimal point in line "
            f"{lines[point]}; write all numbers alike",
        )
    if comma is not None:
        return ","
    if point is not None:
        return "."
    return default
