"""Reactive power demand on the plant in each step, and its forecast."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bess.arrays import Array
from bess.simulation.demand import padded
from bess.simulation.run_demand import forecast_of, repair_notes
from bess.study.grid import SampledSeries, TimeGrid

if TYPE_CHECKING:
    from bess.dispatch import Forecast
    from bess.study.reactive import ReactiveSection


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


def reactive_of(
    choice: ReactiveSection, grid: TimeGrid, horizon: int
) -> tuple[ReactiveSource, list[Path], list[str]]:
    """Return the source of the section ``[reactive]``, its files, and notes on them.

    Raises
    ------
    InputError
        The file is invalid or does not cover the run.
    """
    from bess.dispatch import PerfectForecast, read_profile

    if choice.power_factor is not None:
        note = f"reactive power: at a power factor of {choice.power_factor:g}"
        return AtPowerFactor(choice.power_factor), [], [note]
    wanted = grid.longer(horizon)
    if choice.file is None:
        values = np.full(wanted.n_steps, choice.kvar)
        return Foreseen(PerfectForecast(values)), [], [f"reactive power: {choice.kvar:g} kvar"]
    read = read_profile(
        choice.file,
        column=choice.column,
        unit=choice.unit,
        scale=choice.scale,
        dt_h=grid.dt_h,
        time_zone=choice.time_zone,
        fill=choice.fill,
    )
    series = SampledSeries.from_pandas(read, choice.file, "reactive.file")
    values = series.laid(grid, wanted, repeat=choice.repeat)
    asked = values[: grid.n_steps]
    found = f"reactive power: {choice.file}, {asked.min():g} to {asked.max():g} kvar"
    forecast = forecast_of(choice.forecast, values, grid.dt_h)
    return Foreseen(forecast), [Path(choice.file)], [found, *repair_notes(read)]
