"""Reactive power demand of a run."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from bess.arrays import Array
from bess.dispatch import Forecast, PerfectForecast, read_profile
from bess.study.demands.source import Setting, forecast_of, padded
from bess.study.grid import TimeGrid
from bess.study.sections import ReactiveSection


class ReactiveSource(Protocol):
    """Returns the reactive power demand of a step and its forecast; it has no state."""

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """Return the reactive power [kvar] of ``step`` (binding) and the forecast of the next ones.

        ``demand_kw`` is the active power of these steps, with the same length.
        """


class AtPowerFactor:
    """Reactive power in proportion to active power."""

    def __init__(self, power_factor: float) -> None:
        self._kvar_per_kw = np.sqrt(1.0 - power_factor**2) / power_factor

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """See :class:`ReactiveSource`."""
        return np.asarray(np.abs(demand_kw) * self._kvar_per_kw)


class Foreseen:
    """A separate series of reactive power."""

    def __init__(self, forecast: Forecast) -> None:
        self._forecast = forecast

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """See :class:`ReactiveSource`."""
        return padded(self._forecast.ahead(step, demand_kw.size), demand_kw.size)


def reactive_of(choice: ReactiveSection, setting: Setting, grid: TimeGrid) -> ReactiveSource:
    """Return the source of the section ``[reactive]``.

    Raises
    ------
    InputError
        The file is invalid or does not cover the run.
    """

    if choice.power_factor is not None:
        setting.note(f"reactive power: at a power factor of {choice.power_factor:g}")
        return AtPowerFactor(choice.power_factor)
    wanted = grid.longer(setting.horizon)
    if choice.file is None:
        setting.note(f"reactive power: {choice.kvar:g} kvar")
        return Foreseen(PerfectForecast(np.full(wanted.n_steps, choice.kvar)))
    read = read_profile(
        choice.file,
        column=choice.column,
        unit=choice.unit,
        scale=choice.scale,
        dt_h=grid.dt_h,
        time_zone=choice.time_zone,
        fill=choice.fill,
    )
    series = setting.series_of(read, choice.file, "reactive.file")
    values = series.laid(grid, wanted, repeat=choice.repeat)
    asked = values[: grid.n_steps]
    setting.note(f"reactive power: {choice.file}, {asked.min():g} to {asked.max():g} kvar", series)
    return Foreseen(forecast_of(choice.forecast, values, grid.dt_h))
