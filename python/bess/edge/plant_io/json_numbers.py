"""What counts as a number in JSON that a plant sends."""

from __future__ import annotations

import math


def number(value: object) -> float:
    """Return a finite number; NaN for anything else, texts and truth values included."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value) if math.isfinite(value) else math.nan
    except OverflowError:  # an integer beyond the range of floats
        return math.nan
