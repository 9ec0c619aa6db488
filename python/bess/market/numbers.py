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
_DECIMALS: Final = {
    ",": re.compile(r",(\d{1,2}|\d{4,})(e|$)", re.MULTILINE),
    ".": re.compile(r"\.(\d{1,2}|\d{4,})(e|$)", re.MULTILINE),
}
_SIMPLE: Final = re.compile(r"[\d.,+\n-]*", re.ASCII)
_PLAIN: Final = re.compile(r"(?:(?:[+-]?\d+(?:\.\d*)?|nan)(?:\n|$))*", re.ASCII)
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
    cells = [cell.replace("\n", " ") for cell in cells]  # a line break within quotes is none between cells
    together = "\n".join(cells)
    texts = together.split("\n") if _SIMPLE.fullmatch(together) else _cleaned(cells)
    decimal = _decimal(path, name, texts, lines, default)
    thousands = "." if decimal == "," else ","
    quick = _quick(texts, decimal, thousands)
    if quick is not None:
        return quick
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


def _cleaned(cells: list[str]) -> list[str]:
    return [cell.translate(_CLEAN).lower() for cell in cells]


def _quick(texts: list[str], decimal: str, thousands: str) -> npt.NDArray[np.float64] | None:
    """Return the numbers of a column in which all is plain, None if one of them needs a closer look."""
    plain = [text or "nan" for text in texts]
    together = "\n".join(plain)
    if thousands in together or not _PLAIN.fullmatch(together.replace(decimal, ".")):
        return None
    values = np.array(together.replace(decimal, ".").split("\n"), dtype=np.float64)
    return None if (np.abs(values) > _LARGEST).any() else values


def check_size(path: str, name: str, value: float, line: int) -> None:
    """Raise InputError for a number that no price, power or temperature has; infinity among them."""
    if abs(value) > _LARGEST:
        fail(path, line, f"{value:g} in column {name!r} is beyond {_LARGEST:g}; correct the number")


_NAMES: Final = {",": "comma", ".": "point"}


def _decimal(path: str, name: str, texts: list[str], lines: list[int], default: str) -> str:
    together = "\n".join(texts)
    found = {sign: pattern.search(together) for sign, pattern in _DECIMALS.items()}
    first = {sign: None if m is None else together.count("\n", 0, m.start()) for sign, m in found.items()}
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
