"""Load and generation behind the meter of a plant, and the tariff of its peak, from the files of a study."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bess.arrays import Array
from bess.dispatch import (
    SITES,
    Forecast,
    PeakTariff,
)
from bess.dispatch.connection import QUARTER_S
from bess.errors import InputError
from bess.simulation.run_demand import forecast_of, power_series, utc_index
from bess.study.grid import SampledSeries, TimeGrid
from bess.study.services import MeterSection
from bess.study.study import Study


@dataclass(frozen=True)
class Site:
    """What is behind a meter beside the plant.

    Attributes
    ----------
    grid : TimeGrid
        Control steps of the run.
    net_kw : ndarray
        Load less generation, for as many steps after the run as the horizon has, or as are known.
    forecast : Forecast
        Its forecast.
    tariff : PeakTariff or None
        Price of the peak.
    series : dict of ndarray, shape (n_steps,)
        Recorded series, by variable name.
    files, notes : list
        Files, and notes on them.
    """

    grid: TimeGrid
    net_kw: Array
    forecast: Forecast
    tariff: PeakTariff | None
    series: dict[str, Array]
    files: list[Path]
    notes: list[str]


def site_of_meter(
    study: Study, choice: MeterSection, step_s: float, horizon: int, grid: TimeGrid | None = None
) -> Site:
    """Read load and generation; without ``grid`` the load says when the run is."""
    place = "demand" if grid is None else "demand.meter"
    power_kw: dict[str, Array] = {}
    files: list[Path] = []
    notes: list[str] = []
    for key in ("load", "pv"):
        if getattr(choice, key) is None:
            continue
        given, more_files, more_notes = _site_series(study, choice, key, place, step_s)
        files, notes = files + more_files, notes + more_notes
        if grid is None:
            start = study.run.start or given.start
            grid = TimeGrid.of(start, step_s, study.run.days or given.days_from(start, step_s))
        power_kw[key] = given.laid(grid, grid.longer(horizon), repeat=choice.repeat)
    assert grid is not None
    n = grid.n_steps
    known = min([n + horizon, *(each.size for each in power_kw.values())])
    load_kw, pv_kw = (power_kw.get(key, np.zeros(known))[:known] for key in ("load", "pv"))
    net_kw = load_kw - pv_kw
    forecast = forecast_of(choice.forecast, net_kw, step_s / 3600.0)
    series = {"load_kw": load_kw[:n], "generation_kw": pv_kw[:n]}
    tariff = None
    if choice.peak_eur_kw_month is not None:
        tariff = _tariff(choice.peak_eur_kw_month, choice.billing_time_zone, grid, place)
        series["peak_price_eur_kw"] = np.full(n, tariff.eur_kw)
        series["billing_month"] = tariff.month.astype(np.float64)
    return Site(grid, net_kw, forecast, tariff, series, files, notes)


def _tariff(eur_kw: float, time_zone: str, grid: TimeGrid, place: str) -> PeakTariff:
    if QUARTER_S % grid.step_s:
        raise InputError(
            f"{place}.peak_eur_kw_month: a control step of {grid.step_s / 60:g} min does not divide "
            "a quarter of an hour, over which the peak is averaged; set system.parameters.control.step_min"
        )
    local = utc_index(grid).tz_convert(time_zone)
    quarter = (grid.start_s + grid.step_s * np.arange(grid.n_steps)) // QUARTER_S
    return PeakTariff(eur_kw, np.asarray(100 * local.year + local.month, dtype=np.int64), quarter)


def _site_series(
    study: Study, choice: MeterSection, key: str, place: str, step_s: float
) -> tuple[SampledSeries, list[Path], list[str]]:
    """Return the power of the load or of the generation [kW]."""
    name = getattr(choice, key)
    column = choice.column if key == "load" else choice.pv_column
    scale = choice.scale if key == "load" else choice.pv_scale
    series, files, repairs = power_series(
        name,
        f"{place}.{key}",
        SITES,
        study.run.start,
        step_s,
        scale=scale,
        column=column,
        unit=choice.unit,
        time_zone=choice.time_zone,
        fill=choice.fill,
    )
    found = f"{key}: {series.what}, {series.values.min():.4g} to {series.values.max():.4g} kW"
    return series, files, [found, *repairs]
