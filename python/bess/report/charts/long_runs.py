"""Curves of long runs: light enough for a page, and still showing every peak.

Up to a month a curve is drawn as recorded, thinned to ``POINTS_PER_SERIES`` points by keeping the
smallest and the largest value of each bucket. Of longer runs each day is drawn as its mean, with a pale
band from its smallest to its largest value: a year of cycles as one line would be a solid block of colour.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from matplotlib.colors import to_hex, to_rgb

from bess.report.data import TimeAxis
from bess.report.drawing.chart import Series, Values

POINTS_PER_SERIES: Final = 3000
_POINTS_PER_CHART = 40_000
_PALE = 0.7


def curve(
    time: TimeAxis,
    values: Values,
    colour: str,
    label: str = "",
    *,
    kind: Literal["line", "step"] = "line",
    dashed: bool = False,
    among: int = 1,
    band: bool = True,
) -> list[Series]:
    """Return the series that draw one quantity.

    Parameters
    ----------
    time
        Time axis of the result.
    values
        Shape ``(n,)``: means over steps; or ``(n + 1,)``: states at the edges of steps.
    colour, label, kind, dashed
        As in :class:`~bess.report.drawing.chart.Series`.
    among
        Number of such curves in the chart, which share its points.
    band
        Whether a long run gets the band between its daily extremes.
    """
    edges = len(values) > len(time.start)
    if not time.daily:
        shown = values if edges else held(values)
        limit = int(np.clip(_POINTS_PER_CHART // among, 500, POINTS_PER_SERIES))
        return [Series(*thin(time.edges, shown, limit), colour, label, kind, dashed=dashed)]
    days, low, mean, high = daily(time, values[1:] if edges else values)
    series = [Series(days, held(mean), colour, label, "step" if kind == "step" else "line", dashed=dashed)]
    if band:
        series.insert(0, Series(days, held(high), pale(colour), "", "band", held(low)))
    return series


def daily(time: TimeAxis, values: Values) -> tuple[Values, Values, Values, Values]:
    """Edges of the days ``(days + 1,)``, and minimum, mean and maximum of each day ``(days, ...)``."""
    starts = np.arange(0, len(values), time.steps_per_day)
    counts = np.diff(np.append(starts, len(values))).reshape(-1, *[1] * (values.ndim - 1))
    return (
        np.append(time.start[starts], time.edges[-1]),
        np.minimum.reduceat(values, starts, axis=0),
        np.add.reduceat(values, starts, axis=0) / counts,
        np.maximum.reduceat(values, starts, axis=0),
    )


def thin(x: Values, y: Values, limit: int = POINTS_PER_SERIES) -> tuple[Values, Values]:
    """Keep about ``limit`` points: of each bucket the smallest and the largest value, and both ends."""
    if len(y) <= limit:
        return x, y
    size = -(-len(y) // max(limit // 2, 1))
    padded = np.full(size * -(-len(y) // size), np.nan)
    padded[: len(y)] = y
    rows = padded.reshape(-1, size)
    start = np.arange(len(rows)) * size
    low = start + np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1)
    high = start + np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1)
    keep = np.unique(np.concatenate([low, high, [0, len(y) - 1]]))
    return x[keep], y[keep]


def held(values: Values) -> Values:
    """Repeat the last value, so that a step line reaches the end of the last step."""
    return np.append(values, values[-1:], axis=0)


def pale(colour: str) -> str:
    """Mix a colour with white."""
    red, green, blue = (_PALE + (1.0 - _PALE) * part for part in to_rgb(colour))
    return to_hex((red, green, blue))
