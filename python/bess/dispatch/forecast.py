"""Forecast interface: values known at a step about later steps."""

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from bess.arrays import Array, finite_array
from bess.errors import InputError


@runtime_checkable
class Forecast(Protocol):
    """Forecast of a series, of demand (kW) or of prices (EUR/MWh).

    A forecast is stateless: the same call gives the same answer, so an interrupted run can resume.
    """

    def ahead(self, step: int, horizon: int) -> Array:
        """Return the series at `step`, `step` + 1, … as forecast at the start of `step`.

        Parameters
        ----------
        step : int
            Index of the present control step; its value is known.
        horizon : int
            Number of steps including `step`, ``>= 1``.

        Returns
        -------
        numpy.ndarray, shape (min(horizon, steps left),)
            Shorter than `horizon` where the series ends.
        """
        ...


class ExternalForecast:
    """External forecast: one value for each step, made before the run.

    The present value is known; for later steps the forecast is given.

    Parameters
    ----------
    values : array, shape (n_steps,)
        The actual series; finite.
    forecast : array, shape (n_steps,)
        Its forecast; finite.
    price_ends : array of int, shape (n_steps,), optional
        First step after each at which another value begins (:func:`price_ends_of`): until then the present
        value is known. By default the next step.
    """

    def __init__(
        self,
        values: npt.ArrayLike,
        forecast: npt.ArrayLike,
        *,
        price_ends: npt.NDArray[np.int64] | None = None,
    ):
        self.values, self.forecast = checked_series(values), checked_series(forecast)
        self._price_ends = np.arange(1, self.values.size + 1) if price_ends is None else price_ends
        if self.values.size != self.forecast.size:
            raise InputError(
                f"a forecast of {self.forecast.size} steps does not fit a series of {self.values.size}"
            )

    def ahead(self, step: int, horizon: int) -> Array:
        """Return the present value and the forecast; see :class:`Forecast`."""
        check_step(step, horizon, self.values.size)
        ahead = self.forecast[step : step + horizon].copy()
        ahead[: self._price_ends[step] - step] = self.values[step]
        return ahead


class PerfectForecast(ExternalForecast):
    """Perfect foresight: the forecast is the series itself.

    Parameters
    ----------
    values : array, shape (n_steps,)
        The actual series; finite.
    """

    def __init__(self, values: npt.ArrayLike):
        super().__init__(values, values)


class PersistenceForecast:
    """Forecasts each step by the latest known value at the same time of day (UTC).

    The present value is known. A later step takes the latest known value a multiple of 24 h before, also if
    the clock changes; if the series does not reach back that far, the present value is held.

    Parameters
    ----------
    values : array, shape (n_steps,)
        The actual series; finite.
    dt_h : float
        Control step in hours; must divide a day.
    price_ends : array of int, shape (n_steps,), optional
        See :class:`ExternalForecast`.
    first : int
        Index of step 0 in ``values``; earlier values are known from the start.
    """

    def __init__(
        self,
        values: npt.ArrayLike,
        dt_h: float = 0.25,
        *,
        price_ends: npt.NDArray[np.int64] | None = None,
        first: int = 0,
    ):
        self.values, self._first = checked_series(values), first
        self.price_ends = np.arange(1, self.values.size + 1) if price_ends is None else price_ends
        self.steps_per_day = steps_in(24.0, dt_h, "a day")

    def ahead(self, step: int, horizon: int) -> Array:
        """Return the values of the day before; see :class:`Forecast`."""
        start = step + self._first
        check_step(start, horizon, self.values.size)
        later = np.arange(start, min(start + horizon, self.values.size))
        days_back = -(-(later - start) // self.steps_per_day)
        source = later - days_back * self.steps_per_day
        held: Array = np.where(source < 0, self.values[start], self.values[np.maximum(source, 0)])
        held[: self.price_ends[start] - start] = self.values[start]
        return held


def steps_in(duration_h: float, dt_h: float, what: str) -> int:
    """Return the number of steps of `dt_h` in `duration_h`, a whole number >= 1."""
    steps = whole_steps(duration_h, dt_h)
    if steps is None:
        raise InputError(
            f"{what} ({duration_h:g} h) must be a whole number of steps of {dt_h:g} h, at least one"
        )
    return steps


def whole_steps(duration_h: float, dt_h: float) -> int | None:
    """Return the number of steps of `dt_h` in `duration_h`; None if it is not a whole number >= 1."""
    if not (np.isfinite(dt_h) and dt_h > 0.0):
        raise InputError(f"control step {dt_h} h must be above 0 h")
    steps = duration_h / dt_h if np.isfinite(duration_h) else 0.0
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-9 * steps:
        return None
    return round(steps)


def price_ends_of(values: Array, dt_h: float) -> npt.NDArray[np.int64]:
    """Return the first step after each at which another price may begin, shape ``(n_steps,)``.

    The duration of a price is the longest, up to an hour, that is consistent with all price changes of its
    day and of the hour after it: hourly prices can give way to prices of quarter hours.
    """
    hour, day = max(1, round(1.0 / dt_h)), steps_in(24.0, dt_h, "a day")
    ends, changes = np.arange(values.size), np.flatnonzero(np.diff(values) != 0.0) + 1
    for begin in range(0, values.size, day):
        here = changes[(changes >= begin) & (changes < begin + day + hour)]
        first = here[0] if here.size else begin
        lasts = next(n for n in range(hour, 0, -1) if hour % n == 0 and not ((here - first) % n).any())
        own = ends[begin : begin + day]
        own += lasts - (own - first) % lasts
    return ends


def checked_series(values: npt.ArrayLike) -> Array:
    """Return a series as numbers."""
    series = finite_array("the series of a forecast", values).copy()
    if series.ndim != 1 or series.size == 0:
        raise InputError(f"a forecast needs a series of at least one value; its shape is {series.shape}")
    series.flags.writeable = False
    return series


def check_step(step: int, horizon: int, size: int) -> None:
    """Raise InputError for a step outside a series of ``size`` steps, and for an empty horizon."""
    if not 0 <= step < size:
        raise InputError(f"step {step} is outside the series of {size} steps [0, {size - 1}]")
    if horizon < 1:
        raise InputError(f"horizon {horizon} steps must be at least 1")
