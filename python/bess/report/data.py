"""Chart data of a result: time axis, states including the initial state, and curves of long runs.

Runs of up to a month are drawn as recorded, thinned to ``POINTS_PER_SERIES`` points by keeping the smallest
and the largest value of each bucket. Longer runs are drawn as daily means, with a pale band of the daily
range: a year of cycles as one line would be a solid block of colour."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from hashlib import sha256
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

import numpy as np
from matplotlib.colors import to_hex, to_rgb

from bess.errors import InputError
from bess.report.drawing.chart import Series, Span, Values
from bess.report.drawing.style import INK, colours
from bess.simulation.record.dataset import FLOWS, study_of

if TYPE_CHECKING:
    import xarray as xr

    from bess.simulation import record


Result: TypeAlias = "xr.Dataset | record.Result"
Results: TypeAlias = "Result | Mapping[str, Result]"

_HOURS_UP_TO = 96.0
_DAILY_FROM_DAYS = 31.0


def dataset_of(result: Result) -> xr.Dataset:
    """Return the dataset of a result; a dataset is returned as it is."""
    dataset: xr.Dataset = getattr(result, "dataset", result)  # type: ignore[arg-type]
    if dataset.sizes.get("time", 0) == 0:
        raise InputError("the result has no time steps yet; run the study first")
    return dataset


def told_apart(results: Results) -> Iterator[tuple[str, xr.Dataset, str, bool]]:
    """Yield name, dataset, colour, and whether lines are dashed, for each result; a single one has no name.

    Curves of identical runs coincide: the later ones are dashed, so that the first remains visible, and named
    after it.
    """
    # A dataset is a mapping of its variables, so it has to be ruled out first.
    several = isinstance(results, Mapping) and not hasattr(results, "sizes")
    named: Mapping[str, Result] = results if several else {"": results}  # type: ignore[assignment, dict-item]
    if not named:
        raise InputError("there is no result to draw")
    seen: dict[bytes, str] = {}
    for (name, result), colour in zip(named.items(), colours(len(named)), strict=True):
        dataset = dataset_of(result)
        first = seen.setdefault(operation_of(dataset), name)
        yield (name if first == name else f"{name} (as {first})"), dataset, colour, first != name


def operation_of(dataset: xr.Dataset) -> bytes:
    """Digest of all that the plant did; equal for runs that are identical in every step."""
    digest = sha256()
    for name in FLOWS:
        digest.update(dataset[name].values.tobytes() if name in dataset else b"-")
    return digest.digest()


def step_h(dataset: xr.Dataset) -> float:
    """Length of a step [h]."""
    times = dataset["time"].values
    if len(times) < 2:
        return float(dataset.attrs["step_h"])
    return float((times[1] - times[0]) / np.timedelta64(1, "s")) / 3600.0


class TimeAxis:
    """Instants of a result: hours since the start for runs of up to four days, else dates in UTC.

    Attributes
    ----------
    start : ndarray, shape (n,)
        Start of each step.
    edges : ndarray, shape (n + 1,)
        Start of each step, and the end of the last.
    label : str
        Axis label.
    step_h, steps_per_day : float, int
        Length of a step [h], and number of steps of a day, at least 1.
    daily : bool
        Whether the run is so long that days are drawn, not steps.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        times = dataset["time"].values.astype("datetime64[s]")
        self.step_h = step_h(dataset)
        step = np.timedelta64(round(self.step_h * 3600.0), "s")
        self._first, self._last = times[0], times[-1] + step
        hours = (self._last - self._first) / np.timedelta64(3600, "s")
        self._in_hours = bool(hours <= _HOURS_UP_TO)
        since = np.datetime_as_string(self._first, unit="m").replace("T", " ")
        self.label = f"Time since {since} UTC (h)" if self._in_hours else "Time (UTC)"
        self.edges = self.place(np.append(times, self._last))
        self.start = self.edges[:-1]
        self.steps_per_day = max(round(24.0 / self.step_h), 1)
        self.daily = bool(hours > 24.0 * _DAILY_FROM_DAYS)

    def place(self, instants: Values) -> Values:
        """Return instants on this axis, no earlier than its start and no later than its end."""
        within: Values = np.clip(instants, self._first, self._last)
        return (within - self._first) / np.timedelta64(3600, "s") if self._in_hours else within


def events_of(study: Mapping[str, Any]) -> Iterator[tuple[datetime, datetime, str, Mapping[str, Any]]]:
    """Start and end (UTC), effect on the string, and table of each event of a study, in its order."""
    for event in study.get("event", ()):
        start, end = (datetime.fromisoformat(str(event[key])).astimezone(UTC) for key in ("start", "end"))
        limit_kw = float(event.get("limit_kw", 0.0))
        yield start, end, f"limited to {limit_kw:g} kW" if limit_kw > 0.0 else "out of service", event


def event_spans(dataset: xr.Dataset, time: TimeAxis) -> list[Span]:
    """Events of the study in a record, within its time span."""
    spans = []
    for start, end, effect, event in events_of(study_of(dataset)):
        low, high = time.place(np.array([each.replace(tzinfo=None) for each in (start, end)], "M8[s]"))
        if low < high:
            spans.append(Span(low, high, f"string {event['string']} {effect}"))
    return spans


POINTS_PER_SERIES: Final = 3000
_POINTS_PER_CHART = 40_000
MAX_CURVES: Final = 64
"""Maximum number of strings with a curve each; above it, their distribution is drawn."""
_PALE = 0.7


def curve(
    time: TimeAxis,
    values: Values,
    colour: str,
    label: str = "",
    *,
    kind: Literal["line", "step", "band"] = "line",
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
    series = [Series(days, held(mean), colour, label, kind, dashed=dashed)]
    if band:
        series.insert(0, Series(days, held(high), pale(colour), "", "band", held(low)))
    return series


def string_curves(time: TimeAxis, values: Values, quantities: int = 1) -> list[Series]:
    """Series of one quantity of every string, shape ``(n, n_strings)``; ``quantities`` share the points.

    More than :data:`MAX_CURVES` strings are drawn as their range, the middle 80 %, the median, and by name
    the strings with the highest and the lowest mean.
    """
    n_strings = values.shape[1]
    edges = len(values) > len(time.start)
    kind: Literal["line", "step"] = "line" if edges else "step"
    if n_strings <= MAX_CURVES:
        among = quantities * n_strings
        each = [
            curve(time, values[:, i], colour, f"string {i}", kind=kind, among=among, band=False)
            for i, colour in enumerate(colours(n_strings))
        ]
        return [line for lines in each for line in lines]
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
        Series(x, middle, INK, "median", kind),
        *(
            Series(*thin(x, shown[:, index], POINTS_PER_SERIES), colour, f"string {index}", kind)
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
