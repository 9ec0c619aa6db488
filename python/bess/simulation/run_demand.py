"""Demand of a run: its control steps, source and recorded series, and common functions of its builders."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bess.arrays import Array
from bess.simulation.demand import DemandSource
from bess.study.grid import SampledSeries, TimeGrid, seconds_of
from bess.study.keys import check_bundled
from bess.study.sections import BudgetSection
from bess.system import System
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import pandas as pd

    from bess.dispatch import CycleBudget, Forecast

DEFAULT_START: Final = datetime(2024, 1, 1, tzinfo=UTC)
"""Start of a run whose demand has no time stamps."""


@dataclass(frozen=True)
class RunDemand:
    """Demand of a run.

    Attributes
    ----------
    grid : Grid
        Control steps of the run.
    source : DemandSource
        Source of the demand of each step.
    price_eur_mwh : ndarray, shape (n_steps,), or None
        Price of energy, if the study has one.
    files : list of Path
        Files of the demand.
    notes : list of str
        Notes on these files, for display.
    series : dict of ndarray, shape (n_steps,)
        Other recorded series, by variable name.
    """

    grid: TimeGrid
    source: DemandSource
    price_eur_mwh: Array | None = None
    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    series: Mapping[str, Array] = field(default_factory=dict)


def utc_index(grid: TimeGrid) -> pd.DatetimeIndex:
    """Start of each step as an index in UTC."""
    import pandas as pd

    return pd.DatetimeIndex(grid.times).tz_localize("UTC")


def repair_notes(series: pd.Series[float]) -> list[str]:
    """Return the repairs of a reader, one sentence each."""
    return [f"repaired: {repair}" for repair in series.attrs.get("repairs", ())]


def power_series(
    name: str,
    key: str,
    bundled: Mapping[str, Callable[..., Array]],
    start: datetime | None,
    step_s: float,
    *,
    scale: float = 1.0,
    **reading: Any,
) -> tuple[SampledSeries, list[Path], list[str]]:
    """Return a profile, bundled or from a file, with its files and repairs.

    ``reading`` are further arguments of :func:`bess.dispatch.read_profile`.
    """
    from bess.dispatch import read_profile

    check_bundled(key, name, bundled)
    dt_h = step_s / 3600.0
    if name in bundled:
        values, start_s = bundled[name](dt_h=dt_h) * scale, seconds_of(start or DEFAULT_START)
        return SampledSeries(values, start_s, round(step_s), f"profile {name}", key), [], []
    read = read_profile(name, scale=scale, dt_h=dt_h, **reading)
    return SampledSeries.from_pandas(read, name, key), [Path(name)], repair_notes(read)


def forecast_of(kind: str, values: Array, dt_h: float) -> Forecast:
    """Return the ``"perfect"`` or ``"persistence"`` forecast of a series."""
    from bess.dispatch import PerfectForecast, PersistenceForecast

    return PerfectForecast(values) if kind == "perfect" else PersistenceForecast(values, dt_h)


def budget_of(
    limits: BudgetSection,
    system: System,
    grid: TimeGrid,
    prices: Forecast,
    size: tuple[float, float],
    efficiency: float,
    look_ahead_h: float,
) -> CycleBudget | None:
    """Return the yearly budget, if any; ``size`` is the power [kW] and energy [kWh] available for trading."""
    from bess.dispatch import CycleBudget
    from bess.dispatch.forecast import steps_in

    if not limits.is_set:
        return None
    power_kw, energy_kwh = size
    return CycleBudget(
        prices,
        grid.years,
        grid.n_steps,
        cycles=limits.cycles_per_year or np.inf,
        throughput_kwh=KWH_PER_MWH * (limits.throughput_mwh_per_year or np.inf),
        nominal_kwh=float(system.nominal_energy_kwh.sum()),
        usable_kwh=energy_kwh,
        power_kw=power_kw,
        efficiency=efficiency,
        look_ahead_steps=steps_in(look_ahead_h, grid.dt_h, "demand.look_ahead_h"),
        dt_h=grid.dt_h,
    )
