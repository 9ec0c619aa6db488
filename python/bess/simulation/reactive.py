"""Reactive power demand of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bess.arrays import Array
from bess.dispatch import Forecast, PerfectForecast, read_profile
from bess.study.demands.source import Setting, forecast_of, padded
from bess.study.grid import TimeGrid
from bess.study.sections import ReactiveSection


@dataclass(frozen=True)
class ReactiveDemand:
    """Reactive power of each step: a separate series, or in proportion to active power; without state.

    Attributes
    ----------
    forecast : Forecast or None
        The separate series [kvar]; None for reactive power in proportion to active power.
    kvar_per_kw : float
        Reactive power over active power, without a separate series.
    """

    forecast: Forecast | None = None
    kvar_per_kw: float = 0.0

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """Return the reactive power [kvar] of ``step`` (binding) and the forecast of the next ones.

        ``demand_kw`` is the active power of these steps, with the same length.
        """
        if self.forecast is None:
            return np.asarray(np.abs(demand_kw) * self.kvar_per_kw)
        return padded(self.forecast.ahead(step, demand_kw.size), demand_kw.size)


def reactive_of(choice: ReactiveSection, setting: Setting, grid: TimeGrid) -> ReactiveDemand:
    """Return the demand of the section ``[reactive]``.

    Raises
    ------
    InputError
        The file is invalid or does not cover the run.
    """
    if choice.power_factor is not None:
        setting.note(f"reactive power: at a power factor of {choice.power_factor:g}")
        return ReactiveDemand(kvar_per_kw=np.sqrt(1.0 - choice.power_factor**2) / choice.power_factor)
    wanted = grid.longer(setting.horizon)
    if choice.file is None:
        setting.note(f"reactive power: {choice.kvar:g} kvar")
        return ReactiveDemand(PerfectForecast(np.full(wanted.n_steps, choice.kvar)))
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
    return ReactiveDemand(forecast_of(choice.forecast, values, grid.dt_h))
