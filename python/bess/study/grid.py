"""Time grid of a run, and resampling of series from files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.errors import InputError
from bess.units import SECONDS_PER_DAY, SECONDS_PER_HOUR

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class TimeGrid:
    """Control steps of equal length from ``start`` on, in whole seconds since 1970 (UTC)."""

    start_s: int
    step_s: int
    n_steps: int

    @classmethod
    def of(cls, start: datetime, step_s: float, days: float) -> TimeGrid:
        """Return the time grid of ``days`` days, a whole number of steps."""
        steps = days * SECONDS_PER_DAY / step_s
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            below, above = (
                max(1, n) * step_s / SECONDS_PER_DAY for n in (math.floor(steps), math.ceil(steps))
            )
            nearest = f"{below:.10g}" if below == above else f"{below:.10g} and {above:.10g}"
            raise InputError(
                f"run.days = {days:g}: must be a whole number of steps of {step_s / 60:g} min, at least one; "
                f"nearest: {nearest}"
            )
        try:
            start + timedelta(days=days)
        except OverflowError:
            raise InputError(
                f"run.start = {start:%Y-%m-%d %H:%M}: the run ends after the year 9999"
            ) from None
        return cls(seconds_of(start), round(step_s), round(steps))

    @classmethod
    def of_record(cls, dataset: xr.Dataset) -> TimeGrid:
        """Return the time grid of a record."""
        start_s = int(dataset["time"].values[0].astype("datetime64[s]").astype(np.int64))
        return cls(start_s, round(SECONDS_PER_HOUR * float(dataset.attrs["step_h"])), dataset.sizes["time"])

    def __str__(self) -> str:
        return f"{self.span}, {self.n_steps} steps of {self.step_s / 60:g} min"

    @property
    def end_s(self) -> int:
        """End of the last step."""
        return self.start_s + self.step_s * self.n_steps

    @property
    def times(self) -> NDArray[np.datetime64]:
        """Start of each step, UTC."""
        return (self.start_s + self.step_s * np.arange(self.n_steps)).astype("datetime64[s]")

    @property
    def index(self) -> pd.DatetimeIndex:
        """Start of each step as an index in UTC."""
        import pandas as pd

        return pd.DatetimeIndex(self.times).tz_localize("UTC")

    @property
    def start(self) -> datetime:
        """Start of the first step, UTC."""
        return datetime.fromtimestamp(self.start_s, tz=UTC)

    @property
    def end(self) -> datetime:
        """End of the last step, UTC."""
        return datetime.fromtimestamp(self.end_s, tz=UTC)

    @property
    def span(self) -> str:
        """Start and end, for messages."""
        return f"{self.start:%Y-%m-%d %H:%M} to {self.end:%Y-%m-%d %H:%M} UTC"

    @property
    def dt_h(self) -> float:
        """Length of a step [h]."""
        return self.step_s / SECONDS_PER_HOUR

    @property
    def years(self) -> NDArray[np.int64]:
        """First step of each year of operation and of the one after the last, which may lie beyond the run.

        A year lasts to the same day and hour of the next.
        """
        import pandas as pd

        first, firsts = pd.Timestamp(self.start_s, unit="s"), [0]
        while firsts[-1] < self.n_steps:
            later_s = int((first + pd.DateOffset(years=len(firsts))).timestamp()) - self.start_s
            firsts.append(-(-later_s // self.step_s))
        return np.array(firsts)

    @property
    def year_shares(self) -> Array:
        """Share of each year of operation that the grid covers: 1, but for the last."""
        years = self.years
        return np.asarray(np.diff(np.minimum(years, self.n_steps)) / np.diff(years))

    def earlier(self, n_steps: int) -> TimeGrid:
        """Return this grid with ``n_steps`` steps before it."""
        return TimeGrid(self.start_s - self.step_s * n_steps, self.step_s, self.n_steps + n_steps)


def seconds_of(instant: datetime) -> int:
    """Whole seconds since 1970 of a time-zone aware instant."""
    return round(instant.timestamp())


@dataclass(frozen=True)
class SampledSeries:
    """Regular series read from a file.

    ``what``, ``key`` and ``repeat_key``, which repeats the series after its end, are used in messages,
    ``repairs`` in notes.
    """

    values: Array
    start_s: int
    step_s: int
    what: str
    key: str
    repeat_key: str | None = None
    repairs: tuple[str, ...] = ()

    @classmethod
    def from_pandas(
        cls, series: pd.Series[float], what: str, key: str, repeat_key: str | None = None
    ) -> SampledSeries:
        """Convert a gap-free series with a time-zone aware index."""
        import pandas as pd

        utc = pd.DatetimeIndex(series.index).tz_convert("UTC").tz_localize(None)
        seconds = utc.to_numpy().astype("datetime64[s]").astype(np.int64)
        if seconds.size < 2:
            raise InputError(f"{key}: {what} has {seconds.size} values; at least two are required")
        values, step_s = np.asarray(series, dtype=np.float64), int(seconds[1] - seconds[0])
        repairs = tuple(f"repaired: {repair}" for repair in series.attrs.get("repairs", ()))
        return cls(values, int(seconds[0]), step_s, what, key, repeat_key, repairs)

    @property
    def grid(self) -> TimeGrid:
        """Times of the values."""
        return TimeGrid(self.start_s, self.step_s, self.values.size)

    def days_from(self, start: datetime, step_s: float) -> float:
        """Days of whole control steps from ``start`` to the end of the series."""
        steps = (self.grid.end_s - seconds_of(start)) // step_s
        if steps < 1:
            raise InputError(
                f"run.start = {start:%Y-%m-%d %H:%M}: {self.key} {self.what} covers {self.grid.span}; "
                f"start at least one step of {step_s / 60:g} min before its end"
            )
        return steps * step_s / SECONDS_PER_DAY

    def on(self, grid: TimeGrid, *, repeat: bool = False) -> Array:
        """Return the mean over each step of ``grid``; each value is held until the next.

        With ``repeat``, the series has no start or end.
        """
        if repeat:
            return self.repeated(grid).on(grid)
        if grid.start_s < self.start_s or grid.end_s > self.grid.end_s:
            # A series repeats after its end, not always before its start.
            repeats = self.repeat_key is not None and self.start_s <= grid.start_s
            advice = f", or {self.repeat_key} = true" if repeats else ""
            raise InputError(
                f"{self.key}: {self.what} covers {self.grid.span}, the run needs {grid.span}; "
                f"set run.start and run.days{advice}"
            )
        # The integral of a held series is piecewise linear: its differences are exact means for any steps.
        knots = self.start_s + self.step_s * np.arange(self.values.size + 1)
        edges = grid.start_s + grid.step_s * np.arange(grid.n_steps + 1)
        if self.step_s % grid.step_s == 0 and (grid.start_s - self.start_s) % grid.step_s == 0:
            return self.values[(edges[:-1] - self.start_s) // self.step_s]
        integral = np.concatenate([[0.0], np.cumsum(self.values * self.step_s)])
        return np.asarray(np.diff(np.interp(edges, knots, integral)) / grid.step_s)

    def repeated(self, grid: TimeGrid) -> SampledSeries:
        """Return the series repeated without start or end, as far as ``grid`` needs it."""
        period_s = self.step_s * self.values.size
        begun_s = (grid.start_s - self.start_s) % period_s
        periods = -((grid.start_s - begun_s - grid.end_s) // period_s)
        return replace(self, values=np.tile(self.values, periods), start_s=grid.start_s - begun_s)
