"""Prices as bands: a few levels and the probabilities of moving between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from bess.arrays import Array, ByValue, real_numbers
from bess.dispatch.forecast import PersistenceForecast, check_step, checked_series
from bess.errors import InputError

_ERROR_QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of measured errors used as levels; with three, the expected price would be less accurate."""

FORECAST_QUANTILES: Final = (0.1, 0.5, 0.9)
"""Quantiles of bands made before a run."""

_WINDOW_DAYS: Final = 28.0
"""Period in which errors and transitions are counted [days]."""

_PRIOR: Final = 1.0
"""Weight of the prior, the probabilities of the levels themselves, in transitions from each level."""


@dataclass(frozen=True, eq=False)
class PriceBands(ByValue):
    """Prices ahead as a Markov chain over a few levels.

    The level can change only where a new price begins, that is, where the price of any level changes.

    Attributes
    ----------
    price_eur_mwh : ndarray, shape (n_levels, n_steps)
        Price of each level. All levels have the known present price.
    transition : ndarray, shape (n_levels, n_levels)
        Probability of each level (column) after each level (row).
    initial : ndarray, shape (n_levels,)
        Probability of each level at the first step.
    """

    price_eur_mwh: Array
    transition: Array
    initial: Array

    @classmethod
    def certain(cls, price_eur_mwh: Array) -> Self:
        """Return known prices as a band of one level."""
        return cls(price_eur_mwh[None], np.ones((1, 1)), np.ones(1))

    @property
    def reduced(self) -> Self:
        """Return bands of one level if all levels are equal."""
        first = self.price_eur_mwh[0]
        return self.certain(first) if (self.price_eur_mwh == first).all() else self

    @cached_property
    def is_new(self) -> npt.NDArray[np.bool_]:
        """Whether a new price begins at each step, ``(n_steps,)``; never at the first."""
        return np.asarray(np.r_[False, (np.diff(self.price_eur_mwh, axis=1) != 0.0).any(axis=0)])

    @cached_property
    def probability(self) -> Array:
        """Probability of each level at each step, shape ``(n_levels, n_steps)``."""
        if len(self.initial) == 1:
            return np.ones_like(self.price_eur_mwh)
        probability = [self.initial]
        for new in self.is_new[1:]:
            probability.append(probability[-1] @ self.transition if new else probability[-1])
        return np.stack(probability, axis=1)

    @property
    def mean_eur_mwh(self) -> Array:
        """Expected price of each step, shape ``(n_steps,)``."""
        bands = self.reduced
        return np.asarray((bands.probability * bands.price_eur_mwh).sum(axis=0))


class BandForecast:
    """Forecast of each price as a few quantiles with transition probabilities.

    Without ``forecast`` they are the quantiles (5, 25, 50, 75, 95 %) of the errors of
    :class:`~bess.dispatch.PersistenceForecast` in the past four weeks, by its age in days. Probabilities of
    transitions are counted in the same weeks; a price between two levels counts for both. Only
    the present price is known.

    Parameters
    ----------
    values : array, shape (n_steps,)
        The actual series; finite.
    dt_h : float
        Control step in hours; must divide a day.
    forecast : array, shape (3, n_steps), optional
        Quantiles of 10, 50 and 90 % made before the run; finite, ascending.
    price_ends : array of int, shape (n_steps,), optional
        See :class:`~bess.dispatch.PersistenceForecast`.
    first : int
        See :class:`~bess.dispatch.PersistenceForecast`.

    Raises
    ------
    InputError
        Series are not finite, do not fit each other, or quantiles do not ascend.
    """

    def __init__(
        self,
        values: npt.ArrayLike,
        dt_h: float = 0.25,
        forecast: npt.ArrayLike | None = None,
        *,
        price_ends: npt.NDArray[np.int64] | None = None,
        first: int = 0,
    ):
        self.values, self._first = checked_series(values), first
        self._persistence = PersistenceForecast(self.values, dt_h, price_ends=price_ends)
        self._price_ends = self._persistence.price_ends
        self._starts = np.flatnonzero(np.diff(self._price_ends, prepend=-1) != 0)
        self._window = round(_WINDOW_DAYS * self._persistence.steps_per_day)
        self._quantiles = np.array(_ERROR_QUANTILES if forecast is None else FORECAST_QUANTILES)
        self.forecast = None if forecast is None else _checked(real_numbers(forecast), self.values.size)

    def ahead(self, step: int, horizon: int) -> Array:
        """Return the expected prices; see :class:`Forecast`."""
        mean, now = self.bands(step, horizon).mean_eur_mwh, step + self._first
        mean[: self._price_ends[now] - now] = self.values[now]
        return mean

    def bands(self, step: int, horizon: int) -> PriceBands:
        """Return the price bands of `step` and later steps, as forecast at the start of `step`.

        Parameters
        ----------
        step, horizon : int
            As for :meth:`ahead`.
        """
        step += self._first
        check_step(step, horizon, self.values.size)
        past = self._starts[(self._starts > step - self._window) & (self._starts <= step)]
        if self.forecast is None:
            levels, past, before = self._measured(step, horizon, past)
        else:
            levels, before = self.forecast[:, step : step + horizon].copy(), self.forecast[:, past]
        levels[:, : self._price_ends[step] - step] = self.values[step]
        if not past.size:
            return PriceBands.certain(levels[self._quantiles.size // 2])
        share = _membership(self.values[past], before)
        between = 0.5 * (self._quantiles[1:] + self._quantiles[:-1])
        counts = share[:, :-1] @ share[:, 1:].T + _PRIOR * np.diff(between, prepend=0.0, append=1.0)
        return PriceBands(levels, counts / counts.sum(axis=1, keepdims=True), share[:, -1])

    def _measured(
        self, step: int, horizon: int, past: npt.NDArray[np.int64]
    ) -> tuple[Array, npt.NDArray[np.int64], Array]:
        """Levels ahead, the past steps that have a forecast of a day before, and their levels."""
        day, price = self._persistence.steps_per_day, self._persistence.ahead(step, horizon)
        days = -(-np.arange(price.size) // day)
        offsets = np.zeros((self._quantiles.size, 1))
        levels, before = price + offsets, np.zeros((self._quantiles.size, 0))
        for age in range(1, max(1, int(days[-1])) + 1):
            later = past[past >= age * day]
            if later.size:
                errors = self.values[later] - self.values[later - age * day]
                offsets = np.quantile(errors, self._quantiles)[:, None]
            levels[:, days == age] += offsets
            if age == 1:
                past, before = later, self.values[later - day] + offsets
        return levels, past, before


def _checked(forecast: Array, size: int) -> Array:
    if forecast.shape != (len(FORECAST_QUANTILES), size):
        raise InputError(
            f"bands of shape {forecast.shape} do not fit a series of {size} steps: give "
            f"{(len(FORECAST_QUANTILES), size)}"
        )
    wrong = ~((np.diff(forecast, axis=0) >= 0.0).all(axis=0) & np.isfinite(forecast).all(axis=0))
    if wrong.any():
        step = int(np.argmax(wrong))
        raise InputError(
            f"bands: quantiles of 10, 50 and 90 % at step {step} are {forecast[:, step].tolist()}; they must "
            "be finite and ascend"
        )
    return forecast.copy()


def _membership(values: Array, levels: Array) -> Array:
    """Return the weight of each level for given values, ``(n_levels, n)``, linear between two levels."""
    width = np.diff(levels, axis=0)
    place = np.clip((values - levels[:-1]) / np.where(width > 0.0, width, 1.0), 0.0, 1.0).sum(axis=0)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(np.arange(len(levels))[:, None] - place)))
