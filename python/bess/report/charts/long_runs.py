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
from bess.report.drawing.style import INK, colours

POINTS_PER_SERIES: Final = 3000
_POINTS_PER_CHART = 40_000
MAX_CURVES: Final = 64
"""Strings with a curve each; of more, how they spread."""
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


def string_curves(time: TimeAxis, values: Values, among: int) -> list[Series]:
    """Series of one quantity of every string, shape ``(n, n_strings)``; else as for :func:`curve`.

    Of more than :data:`MAX_CURVES` strings: their range, the middle 80 %, the median, and by name the strings
    with the highest and the lowest mean.
    """
    n_strings = values.shape[1]
    if n_strings <= MAX_CURVES:
        each = [
            curve(time, values[:, index], colour, f"string {index}", among=among, band=False)
            for index, colour in enumerate(colours(n_strings))
        ]
        return [line for lines in each for line in lines]
    edges = len(values) > len(time.start)
    x, shown = time.edges, values if edges else held(values)
    if time.daily:
        x, _, mean, _ = daily(time, values[1:] if edges else values)
        shown = held(mean)
    least, low, middle, high, most = np.quantile(shown, (0.0, 0.1, 0.5, 0.9, 1.0), axis=1)
    means = shown.mean(axis=0)
    ends = [int(np.argmax(means)), int(np.argmin(means))]
    return [
        Series(x, most, "#DDDDDD", f"{n_strings} strings", "band", least),
        Series(x, high, "#BBBBBB", "the middle 80 %", "band", low),
        Series(x, middle, INK, "median"),
        *(
            Series(*thin(x, shown[:, index], POINTS_PER_SERIES), colour, f"string {index}")
            for index, colour in zip(ends, colours(2), strict=True)
        ),
    ]


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
