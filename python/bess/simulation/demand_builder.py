"""Control steps, active and reactive demand of a run from the sections of its study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.simulation.demand import (
    COMPARE_H,
    LONGEST_H,
    MAX_PLAN_AGE_FRACTION,
    ArbitrageSource,
    AwarePlanner,
    LinearPlanner,
    ProfileSource,
    padded,
)
from bess.simulation.run_demand import (
    RunDemand,
    budget_of,
    forecast_of,
    power_series,
    repair_notes,
    utc_index,
)
from bess.study.demands import ArbitrageDemand, FcrDemand, ProfileDemand, SiteDemand, TradeMeterSection
from bess.study.grid import SampledSeries, TimeGrid
from bess.system import System

if TYPE_CHECKING:
    from bess.dispatch import Forecast, GridConnection
    from bess.simulation.services import Site
    from bess.study.sections import ReactiveSection
    from bess.study.study import Study


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


QUANTILE_COLUMNS = ("p10", "p50", "p90")
"""Columns of a file of price bands."""
HISTORY_DAYS = 30
"""Number of days before a run whose prices a forecast uses, if the file contains them."""


def demand_of(study: Study, system: System, step_s: float, horizon: int) -> RunDemand:
    """Read the files of the section ``[demand]`` and resample them to the control steps of the run."""
    if isinstance(study.demand, ArbitrageDemand):
        return _arbitrage(study, study.demand, system, step_s)
    if isinstance(study.demand, FcrDemand | SiteDemand):
        # Imported here, because other runs do not need these slow imports.
        from bess.simulation.services import reserve_of, site_of

        if isinstance(study.demand, FcrDemand):
            return reserve_of(study, study.demand, system, step_s)
        return site_of(study, study.demand, system, step_s, horizon)
    return _profile(study, study.demand, system, step_s, horizon)


def _profile(study: Study, choice: ProfileDemand, system: System, step_s: float, horizon: int) -> RunDemand:
    from bess.dispatch import PROFILES

    series, files, repairs = power_series(
        choice.file,
        "demand.file",
        PROFILES,
        study.run.start,
        step_s,
        scale=choice.scale,
        column=choice.column,
        unit=choice.unit,
        positive=choice.positive,
        time_zone=choice.time_zone,
        fill=choice.fill,
    )
    start = study.run.start or series.start
    grid = TimeGrid.of(start, step_s, study.run.days or series.days_from(start, step_s))
    # A forecast may extend beyond the end of the run, to the end of the profile.
    wanted = grid.longer(horizon)
    values = series.laid(grid, wanted, repeat=choice.repeat)
    forecast = forecast_of(choice.forecast, values, step_s / 3600.0)
    asked = values[: grid.n_steps]
    above = int((np.abs(asked) > system.nominal_kw.sum() * (1.0 + 1e-9)).sum())
    notes = [f"demand: {series.what}, {asked.min():g} to {asked.max():g} kW", *repairs]
    if above:
        notes.append(
            f"demand is above the {system.nominal_kw.sum():g} kW of the plant in {above} steps (unmet)"
        )
    return RunDemand(grid, ProfileSource(forecast), None, files, notes)


def _arbitrage(study: Study, choice: ArbitrageDemand, system: System, step_s: float) -> RunDemand:
    from bess.dispatch.arbitrage import calendar_days
    from bess.dispatch.markets import AuctionForecast
    from bess.market import extended, read_prices

    if choice.prices is None:
        raise InputError(
            f"{study.name}: demand.prices is not set: name a price file (SMARD, Energy-Charts or ENTSO-E "
            "export), such as demand.prices = FILE.csv"
        )
    read = read_prices(
        choice.prices, choice.zone, choice.product, time_zone=choice.time_zone, fill=choice.fill
    )
    sampled = SampledSeries.from_pandas(read, choice.prices, "demand.prices")
    start = study.run.start or sampled.start
    grid = TimeGrid.of(start, step_s, study.run.days or sampled.days_from(start, step_s))
    if choice.repeat:
        sampled = SampledSeries.from_pandas(extended(read, grid.end), choice.prices, "demand.prices")
    price = sampled.on(grid)
    forecast, files = _price_forecast(choice, grid, sampled)
    connection: GridConnection | None = None
    series: dict[str, Array] = {}
    found: list[str] = []
    if choice.meter is not None:
        connection, site = _connection(study, choice, choice.meter, step_s, grid)
        series = site.series | {"export_price_eur_mwh": price}
        if choice.max_export_kw is not None:
            series["export_limit_kw"] = np.full(grid.n_steps, choice.max_export_kw)
        files, found = files + site.files, site.notes
    notes = [
        f"prices: {choice.prices}, min / mean / max of the run "
        f"{price.min():.2f} / {price.mean():.2f} / {price.max():.2f} EUR/MWh",
        *repair_notes(read),
        *found,
    ]
    if choice.market:
        series, auction_files = _auctions(choice, system, grid, price)
        files = files + auction_files
        if choice.forecast == "persistence":
            days = calendar_days(utc_index(grid), choice.market_time_zone)
            auction = series["auction_price_eur_mwh"][:, -1]
            forecast = AuctionForecast(price, auction, days, grid.dt_h)
    planner = _planner(study, choice, system, grid, forecast, connection)
    budget = budget_of(
        study.budget, system, grid, forecast, _size(choice, system), choice.efficiency, choice.look_ahead_h
    )
    source = ArbitrageSource(planner, system, budget, connection)
    fee_eur_mwh = choice.meter.import_fee_eur_mwh if choice.meter is not None else 0.0
    return RunDemand(grid, source, price + fee_eur_mwh, [Path(choice.prices), *files], notes, series)


def _auctions(
    choice: ArbitrageDemand, system: System, grid: TimeGrid, price: Array
) -> tuple[dict[str, Array], list[Path]]:
    """Positions and prices of the auctions before the last market, as recorded series."""
    from bess.dispatch import Arbitrage, PerfectForecast, StorageEstimator, auction_positions
    from bess.dispatch.arbitrage import calendar_days
    from bess.dispatch.forecast import steps_in
    from bess.market import read_prices

    prices, steps, files = [], [], []
    for number, market in enumerate(choice.market):
        key, file = f"demand.market.{number}", market.prices or str(choice.prices)
        read = read_prices(file, choice.zone, market.product, time_zone=choice.time_zone, fill=choice.fill)
        prices.append(SampledSeries.from_pandas(read, file, f"{key}.prices").on(grid))
        steps.append(steps_in(market.step_min / 60.0, grid.dt_h, f"{key}.step_min"))
        files.append(Path(file))
    power_kw, energy_kwh = _size(choice, system)
    planner = Arbitrage(
        PerfectForecast(price),
        calendar_days(utc_index(grid), choice.market_time_zone),
        power_kw=power_kw,
        energy_kwh=energy_kwh,
        efficiency=choice.efficiency,
        cycles_per_day=choice.cycles_per_day,
        max_import_kw=choice.max_import_kw,
        max_export_kw=choice.max_export_kw,
        look_ahead_h=choice.look_ahead_h,
        replan_h=grid.dt_h,
        dt_h=grid.dt_h,
    )
    stored_kwh = min(
        energy_kwh, StorageEstimator(system, choice.efficiency).stored_kwh(system.initial_state())
    )
    position_kw = auction_positions(
        [*prices, price],
        planner,
        product_steps=steps,
        stored_kwh=stored_kwh,
        foresight=choice.forecast == "perfect",
    )
    return {"position_kw": position_kw, "auction_price_eur_mwh": np.stack(prices, axis=1)}, files


def _connection(
    study: Study, choice: ArbitrageDemand, meter: TradeMeterSection, step_s: float, grid: TimeGrid
) -> tuple[GridConnection, Site]:
    from bess.dispatch import GridConnection
    from bess.simulation.services import site_of_meter

    site = site_of_meter(study, meter, step_s, 0, grid)
    connection = GridConnection(
        site.forecast,
        grid.dt_h,
        max_import_kw=choice.max_import_kw or np.inf,
        max_export_kw=choice.max_export_kw or np.inf,
        import_fee_eur_mwh=meter.import_fee_eur_mwh,
        tariff=site.tariff,
    )
    return connection, site


def _price_forecast(
    choice: ArbitrageDemand, grid: TimeGrid, series: SampledSeries
) -> tuple[Forecast, list[Path]]:
    """Return the price forecast to the end of the run, and its file."""
    from bess.dispatch import BandForecast, ExternalForecast, PerfectForecast, PersistenceForecast
    from bess.dispatch.forecast import price_ends_of
    from bess.market import read_prices

    if choice.forecast == "perfect":
        return PerfectForecast(series.on(grid)), []
    file = choice.forecast_prices
    if file is None:
        # Prices of the file before the run are known.
        before = max(
            0, min((grid.start_s - series.start_s) // grid.step_s, round(HISTORY_DAYS * 24 / grid.dt_h))
        )
        price = series.on(grid.earlier(before))
        kind = PersistenceForecast if choice.forecast == "persistence" else BandForecast
        return kind(price, grid.dt_h, price_ends=price_ends_of(price, grid.dt_h), first=before), []

    def forecast_of(zone: str) -> Array:
        read = read_prices(file, zone, choice.product, time_zone=choice.time_zone, fill=choice.fill)
        return SampledSeries.from_pandas(read, file, "demand.forecast_prices").on(grid)

    price = series.on(grid)
    ends = price_ends_of(price, grid.dt_h)
    if choice.forecast == "file":
        return ExternalForecast(price, forecast_of(choice.zone), price_ends=ends), [Path(file)]
    bands = np.stack([forecast_of(zone) for zone in QUANTILE_COLUMNS])
    return BandForecast(price, grid.dt_h, bands, price_ends=ends), [Path(file)]


def _planner(
    study: Study,
    choice: ArbitrageDemand,
    system: System,
    grid: TimeGrid,
    forecast: Forecast,
    connection: GridConnection | None,
) -> LinearPlanner | AwarePlanner:
    from bess.dispatch import Arbitrage, BandForecast, DynamicProgramDispatch
    from bess.dispatch.arbitrage import calendar_days
    from bess.dispatch.forecast import steps_in

    days = calendar_days(utc_index(grid), choice.market_time_zone)
    if choice.plan == "aware":
        look_ahead = steps_in(choice.look_ahead_h, grid.dt_h, "demand.look_ahead_h")
        replan = None
        if choice.replan_h is not None:
            replan = steps_in(choice.replan_h, grid.dt_h, "demand.replan_h")
        if choice.replan_h is not None and choice.replan_h > choice.look_ahead_h:
            raise InputError(
                f"demand.replan_h {choice.replan_h:g} h must not exceed "
                f"demand.look_ahead_h {choice.look_ahead_h:g} h"
            )
        dispatch = DynamicProgramDispatch(
            system,
            grid.dt_h,
            study.settlement.terms,
            max_power_kw=choice.max_power_kw,
            max_energy_kwh=choice.max_energy_kwh,
            max_import_kw=choice.max_import_kw,
            max_export_kw=choice.max_export_kw,
            cycles_per_day=choice.cycles_per_day,
            cycles_per_plan=choice.cycles_per_plan,
            end_price_eur_mwh=choice.end_price_eur_mwh,
        )
        return AwarePlanner(
            dispatch,
            forecast,
            days,
            bands=forecast if choice.forecast == "bands" and isinstance(forecast, BandForecast) else None,
            look_ahead_steps=look_ahead,
            replan_steps=replan,
            compare_steps=max(1, round(COMPARE_H / grid.dt_h)),
            longest_steps=min(MAX_PLAN_AGE_FRACTION * look_ahead, LONGEST_H / grid.dt_h),
        )
    power_kw, energy_kwh = _size(choice, system)
    arbitrage = Arbitrage(
        forecast,
        days,
        power_kw=power_kw,
        energy_kwh=energy_kwh,
        efficiency=choice.efficiency,
        cycles_per_day=choice.cycles_per_day,
        cycles_per_plan=choice.cycles_per_plan,
        max_import_kw=choice.max_import_kw if connection is None else None,
        max_export_kw=choice.max_export_kw if connection is None else None,
        look_ahead_h=choice.look_ahead_h,
        replan_h=COMPARE_H if choice.replan_h is None else choice.replan_h,
        dt_h=grid.dt_h,
        connection=connection,
    )
    return LinearPlanner(arbitrage)


def _size(choice: ArbitrageDemand, system: System) -> tuple[float, float]:
    """Return the power [kW] and energy [kWh] available for trading."""
    window = np.array([string.battery.soc_max - string.battery.soc_min for string in system.strings])
    energy_kwh = float((system.nominal_energy_kwh * window).sum())
    power_kw = float(system.nominal_kw.sum())
    return min(power_kw, choice.max_power_kw or power_kw), min(
        energy_kwh, choice.max_energy_kwh or energy_kwh
    )
