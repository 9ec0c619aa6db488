"""Chart data of a result: dataset, time axis, and states including the initial state."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from datetime import UTC
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError
from bess.report.drawing.chart import Span

if TYPE_CHECKING:
    import xarray as xr


class HasDataset(Protocol):
    """Interface of the result of :func:`bess.run`."""

    @property
    def dataset(self) -> xr.Dataset:
        """The record of the run."""


Result: TypeAlias = "xr.Dataset | HasDataset"
Results: TypeAlias = "Result | Mapping[str, Result]"

_HOURS_UP_TO = 96.0
_DAILY_FROM_DAYS = 31.0


def dataset_of(result: Result) -> xr.Dataset:
    """Return the dataset of a result; a dataset is returned as it is.

    Raises
    ------
    InputError
        The run has no steps yet.
    """
    dataset: xr.Dataset = getattr(result, "dataset", result)  # type: ignore[arg-type]
    if dataset.sizes.get("time", 0) == 0:
        raise InputError("the result has no time steps yet; run the study first")
    return dataset


def named(results: Results) -> dict[str, xr.Dataset]:
    """Return datasets by name; a single result gets the empty name."""
    # A dataset is a mapping of its variables, so it has to be ruled out first.
    if isinstance(results, Mapping) and not hasattr(results, "sizes"):
        return {name: dataset_of(result) for name, result in results.items()}
    return {"": dataset_of(results)}  # type: ignore[arg-type]


def step_h(dataset: xr.Dataset) -> float:
    """Length of a step [h]."""
    times = dataset["time"].values
    if len(times) < 2:
        return 0.25
    return float((times[1] - times[0]) / np.timedelta64(1, "s")) / 3600.0


class TimeAxis:
    """Instants of a result: hours since the start for runs of up to four days, else dates in UTC.

    Attributes
    ----------
    start : ndarray, shape (n,)
        Start of each step.
    edges : ndarray, shape (n + 1,)
        The same, and the end of the last step.
    label : str
        For the axis.
    steps_per_day : int
        At least 1.
    daily : bool
        Whether the run is so long that days are drawn, not steps.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        times = dataset["time"].values.astype("datetime64[s]")
        step = np.timedelta64(round(step_h(dataset) * 3600.0), "s")
        edges: NDArray[Any] = np.append(times, times[-1] + step)
        hours = (edges - edges[0]) / np.timedelta64(3600, "s")
        if hours[-1] <= _HOURS_UP_TO:
            self.edges = hours
            self.label = f"Time since {np.datetime_as_string(edges[0], unit='m').replace('T', ' ')} UTC (h)"
        else:
            self.edges = edges
            self.label = "Time (UTC)"
        self._instants = edges
        self.start = self.edges[:-1]
        self.steps_per_day = max(round(24.0 / step_h(dataset)), 1)
        self.daily = bool(hours[-1] > 24.0 * _DAILY_FROM_DAYS)

    def place(self, instant: np.datetime64) -> Any:
        """Return an instant on this axis, no earlier than its start and no later than its end."""
        within = min(max(instant, self._instants[0]), self._instants[-1])
        if np.issubdtype(self.edges.dtype, np.datetime64):
            return within
        return (within - self._instants[0]) / np.timedelta64(3600, "s")


def event_spans(dataset: xr.Dataset, time: TimeAxis) -> tuple[Span, ...]:
    """Events of the study that a record carries, within its time."""
    spans = []
    for event in tomllib.loads(dataset.attrs.get("study", "")).get("event", ()):
        start, end = (
            np.datetime64(event[key].astimezone(UTC).replace(tzinfo=None), "s") for key in ("start", "end")
        )
        limit_kw = float(event.get("limit_kw", 0.0))
        what = f"limited to {limit_kw:g} kW" if limit_kw else "out of service"
        low, high = (time.place(instant) for instant in (start, end))
        if low < high:
            spans.append(Span(low, high, f"string {event['string']} {what}"))
    return tuple(spans)


def with_initial(dataset: xr.Dataset, variable: str) -> NDArray[np.float64]:
    """State at the start and at the end of every step, shape ``(n + 1, n_strings)``."""
    values = dataset[variable].values.astype(np.float64)
    initial = dataset.attrs.get(f"initial_{variable}")
    first = np.full(values.shape[1], np.nan) if initial is None else np.atleast_1d(initial).astype(np.float64)
    return np.vstack([np.broadcast_to(first, values.shape[1]), values])
