"""Inputs of a closed loop from a study: system, steps, demand, reactive power, weather and limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bess.arrays import Array
from bess.control.policies.planned import NO_PRICES
from bess.dispatch import Forecast, PerfectForecast, read_profile
from bess.errors import InputError
from bess.simulation.installations import Installations
from bess.study.demands.source import RunDemand, Setting, forecast_of, padded
from bess.study.events import check_events, limits_of
from bess.study.grid import SampledSeries, TimeGrid
from bess.study.plant_choice import build_system
from bess.study.sections import ReactiveSection, WeatherSection
from bess.study.study import Study
from bess.system import System

ReactiveDemand = Callable[[int, Array], Array]
"""Reactive power [kvar] of a step (binding) and forecast of the next ones, from their active power [kW]."""


@dataclass(frozen=True, kw_only=True)
class Inputs(RunDemand):
    """A study with its data: the demand of the run, and further attributes."""

    system: System
    horizon_steps: int
    """Prediction horizon of the policy [steps]."""
    ambient_c: Array
    """``(n_steps,)``: ambient temperature [degC]."""
    limit_kw: Array
    """``(n_steps, n_strings)``: power of each inverter in service."""
    announced_kw: Array
    unannounced_kw: Array
    """``(n_steps, n_strings)``: the same with the announced events only, and with the others only."""
    installations: Installations
    """Strings that are added, replaced or retired."""
    files: list[Path]
    """Files of the study."""
    notes: list[str]
    """Notes on these files, for display."""
    reactive: ReactiveDemand | None = None
    """Reactive power demand, if the study has one."""


def prepare(study: Study, system: System | None = None) -> Inputs:
    """Read all files of a study and check that they cover the run; ``system`` replaces that of the study."""
    system = build_system(study.system, study.run, study.wear, system)
    setting = Setting(study.name, study.run, study.budget, study.settlement, system)
    if not system.control.step_s.is_integer():
        raise InputError(
            f"{system.name}: control.step_min = {system.control.step_min:g}: must be whole seconds"
        )
    demand = study.demand.build(setting)
    if (
        study.policy.name == "mpc"
        and study.policy.objectives.kind == "money"
        and demand.price_eur_mwh is None
    ):
        raise InputError(f"{study.name}: {NO_PRICES}")
    grid = demand.grid
    ambient = np.full(grid.n_steps, system.ambient_c)
    if study.weather.file is not None:
        ambient = _ambient(study.weather, study.weather.file, setting, grid)
    reactive = None if study.reactive is None else _reactive_of(study.reactive, setting, grid)
    check_events(study.event, system, grid)
    files = setting.files
    if study.policy.name == "distilled" and study.policy.file is not None:
        files.append(Path(study.policy.file))
    return Inputs(
        **vars(demand),
        system=system,
        horizon_steps=study.policy.steps_ahead(system.control),
        ambient_c=ambient,
        limit_kw=limits_of(study.event, system, grid),
        announced_kw=limits_of([event for event in study.event if event.announced], system, grid),
        unannounced_kw=limits_of([event for event in study.event if not event.announced], system, grid),
        installations=Installations(system, study, grid),
        files=files,
        notes=[f"period: {grid}", *setting.notes],
        reactive=reactive,
    )


def _ambient(choice: WeatherSection, file: str, setting: Setting, grid: TimeGrid) -> Array:
    """Return the ambient temperature [degC] of each step."""
    from bess.market import extended, over_years, read_weather

    read = read_weather(file, column=choice.column, time_zone=choice.time_zone, fill=choice.fill)
    given = setting.series_of(read, file, "weather.file")
    series = extended(read, grid.end) if choice.repeat else read
    series = over_years(read, grid.start, grid.end) if read.attrs["typical_year"] else series
    values = SampledSeries.from_pandas(series, file, "weather.file", "weather.repeat").on(grid)
    values += choice.offset_k
    setting.note(f"weather: {file}, {values.min():g} to {values.max():g} degC", given)
    return values


def known_reactive(forecast: Forecast) -> ReactiveDemand:
    """Return the reactive power of a separate series."""
    return lambda step, demand_kw: padded(forecast.ahead(step, demand_kw.size), demand_kw.size)


def _reactive_of(choice: ReactiveSection, setting: Setting, grid: TimeGrid) -> ReactiveDemand:
    """Return the demand of the section ``[reactive]``."""
    if choice.power_factor is not None:
        setting.note(f"reactive power: at a power factor of {choice.power_factor:g}")
        kvar_per_kw = np.sqrt(1.0 - choice.power_factor**2) / choice.power_factor
        return lambda step, demand_kw: np.asarray(np.abs(demand_kw) * kvar_per_kw)
    if choice.file is None:
        setting.note(f"reactive power: {choice.kvar:g} kvar")
        return known_reactive(PerfectForecast(np.full(grid.n_steps, choice.kvar)))
    reading = choice.model_dump(include={"column", "unit", "scale", "time_zone", "fill"})
    read = read_profile(choice.file, dt_h=grid.dt_h, **reading)
    series = setting.series_of(read, choice.file, "reactive.file", "reactive.repeat")
    values = series.on(grid, repeat=choice.repeat)
    setting.note(f"reactive power: {choice.file}, {values.min():g} to {values.max():g} kvar", series)
    return known_reactive(forecast_of(choice.forecast, values, grid.dt_h))
