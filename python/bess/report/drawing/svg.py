"""Vector graphics with fewer characters: a page of a year stays light."""

from __future__ import annotations

import re
from typing import Final

_COORDINATES: Final = re.compile(r'\b(?:x|y|points)="[^"]*"')
_PATH: Final = re.compile(r'\bd="([^"]*)"')
_MORE_DIGITS: Final = re.compile(r"(\.\d)\d+")


def shortened(svg: str) -> str:
    """Return a drawing of matplotlib with coordinates to a tenth of a point, finer than a screen or printer.

    Horizontal and vertical lines, of which step lines consist, are written as such.
    """
    svg = _COORDINATES.sub(lambda found: _rounded(found[0]), svg)
    return _PATH.sub(lambda found: f'd="{_short_path(found[1])}"', svg)


def _rounded(text: str) -> str:
    return _MORE_DIGITS.sub(r"\1", text)


def _short_path(path: str) -> str:
    words = _rounded(path).split()
    if not set("".join(words)) <= set("MLz0123456789.-"):
        return path  # curves are few, and small
    shown: list[str] = []
    last = ("", "")
    place = 0
    while place < len(words):
        command = words[place]
        if command == "z":
            shown.append("z")
            place += 1
            continue
        x, y = words[place + 1 : place + 3]
        place += 3
        if command == "M" or (x != last[0] and y != last[1]):
            shown.append(f"{command}{x} {y}")
        elif x != last[0]:
            shown.append(f"H{x}")
        elif y != last[1]:
            shown.append(f"V{y}")
        last = (x, y)
    return "".join(shown)
