"""Reactive power that is asked of the plant in each step, and what the policy is told of the steps ahead."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bess.numbers import Array
from bess.simulation.demand import padded
from bess.simulation.run_demand import repair_notes
from bess.study.grid import Grid, SampledSeries

if TYPE_CHECKING:
    from bess.ems import Forecast
    from bess.study.reactive import ReactiveChoice


class ReactiveSource(Protocol):
    """Gives the reactive power of a step and its forecast; it remembers nothing."""

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """Reactive power [kvar] of ``step`` (binding) and as foreseen for the next ones.

        ``demand_kw`` is the active power of these steps, and as long.
        """


class AtPowerFactor:
    """Reactive power in proportion to active power."""

    def __init__(self, power_factor: float) -> None:
        self._kvar_per_kw = np.sqrt(1.0 - power_factor**2) / power_factor

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """See :class:`ReactiveSource`."""
        return np.asarray(np.abs(demand_kw) * self._kvar_per_kw)


class Foreseen:
    """A series of its own."""

    def __init__(self, forecast: Forecast) -> None:
        self._forecast = forecast

    def ahead(self, step: int, demand_kw: Array) -> Array:
        """See :class:`ReactiveSource`."""
        return padded(self._forecast.ahead(step, demand_kw.size), demand_kw.size)


def reactive_of(
    choice: ReactiveChoice, grid: Grid, horizon: int
) -> tuple[ReactiveSource, list[Path], list[str]]:
    """Source of the section ``[reactive]``, the files it reads, and what was found in them.

    Raises
    ------
    InputError
        From the file, or where it does not cover the run.
    """
    from bess.ems import Perfect, Persistence, read_profile

    if choice.power_factor is not None:
        note = f"reactive power: at a power factor of {choice.power_factor:g}"
        return AtPowerFactor(choice.power_factor), [], [note]
    wanted = grid.longer(horizon)
    if choice.file is None:
        values = np.full(wanted.n_steps, choice.kvar)
        return Foreseen(Perfect(values)), [], [f"reactive power: {choice.kvar:g} kvar"]
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
    forecast = Perfect(values) if choice.forecast == "perfect" else Persistence(values, grid.dt_h)
    asked = values[: grid.n_steps]
    found = f"reactive power: {choice.file}, {asked.min():g} to {asked.max():g} kvar"
    return Foreseen(forecast), [Path(choice.file)], [found, *repair_notes(read)]
