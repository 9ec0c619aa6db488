"""From the section ``[demand]`` of a study to its control steps and what is asked in each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bess.errors import InputError
from bess.numbers import Array
from bess.parameters import System
from bess.simulation.demand import (
    COMPARE_H,
    LONGEST_H,
    LONGEST_SHARE,
    ArbitrageSource,
    AwarePlanner,
    DispatchPlanner,
    LinearPlanner,
    ProfileSource,
)
from bess.simulation.run_demand import DEFAULT_START, RunDemand, repair_notes, utc_index
from bess.study.demands import ArbitrageDemand, ProfileDemand
from bess.study.grid import Grid, SampledSeries, seconds_of
from bess.study.keys import check_bundled
from bess.study.services import FcrDemand, SiteDemand

if TYPE_CHECKING:
    from bess.ems import Forecast
    from bess.study.study import Study


def demand_of(study: Study, system: System, step_s: float, horizon: int) -> RunDemand:
    """Read what the section ``[demand]`` names and lay it onto the control steps of the run."""
    if isinstance(study.demand, ArbitrageDemand):
        return _arbitrage(study, study.demand, system, step_s)
    if isinstance(study.demand, FcrDemand | SiteDemand):
        # Loaded here: what services need takes time that other runs need not spend.
        from bess.simulation.service_choice import reserve_of, site_of

        if isinstance(study.demand, FcrDemand):
            return reserve_of(study, study.demand, system, step_s)
        return site_of(study, study.demand, system, step_s, horizon)
    return _profile(study, study.demand, system, step_s, horizon)


def _profile(study: Study, choice: ProfileDemand, system: System, step_s: float, horizon: int) -> RunDemand:
    from bess.ems import PROFILES, Perfect, Persistence, bundled_profile, read_profile

    dt_h = step_s / 3600.0
    repairs: list[str] = []
    check_bundled("demand.file", choice.file, PROFILES)
    if choice.file in PROFILES:
        series = SampledSeries(
            values=bundled_profile(choice.file, dt_h=dt_h) * choice.scale,
            start_s=seconds_of(study.run.start or DEFAULT_START),
            step_s=round(step_s),
            what=f"profile {choice.file}",
            key="demand.file",
        )
    else:
        read = read_profile(
            choice.file,
            column=choice.column,
            unit=choice.unit,
            positive=choice.positive,
            scale=choice.scale,
            dt_h=dt_h,
            time_zone=choice.time_zone,
            fill=choice.fill,
        )
        series = SampledSeries.from_pandas(read, choice.file, "demand.file")
        repairs = repair_notes(read)
    start = study.run.start or series.start
    grid = Grid.of(start, step_s, study.run.days or series.days_from(start, step_s))
    # A forecast may look past the end of the run, as far as the profile goes.
    wanted = grid.longer(horizon)
    values = series.laid(grid, wanted, repeat=choice.repeat)
    forecast = Perfect(values) if choice.forecast == "perfect" else Persistence(values, dt_h)
    asked = values[: grid.n_steps]
    above = int((np.abs(asked) > system.nominal_kw.sum() * (1.0 + 1e-9)).sum())
    notes = [f"demand: {series.what}, {asked.min():g} to {asked.max():g} kW", *repairs]
    if above:
        notes.append(
            f"demand is above the {system.nominal_kw.sum():g} kW of the plant in {above} steps (unmet)"
        )
    return RunDemand(
        grid, ProfileSource(forecast), None, [] if choice.file in PROFILES else [Path(choice.file)], notes
    )


def _arbitrage(study: Study, choice: ArbitrageDemand, system: System, step_s: float) -> RunDemand:
    from bess.market import prolonged, read_prices

    if choice.prices is None:
        raise InputError(
            f"{study.name}: demand.prices is not set: name a price file (SMARD, Energy-Charts or ENTSO-E "
            "export), such as demand.prices = FILE.csv"
        )
    read = read_prices(
        choice.prices, choice.zone, choice.product, time_zone=choice.time_zone, fill=choice.fill
    )
    series = SampledSeries.from_pandas(read, choice.prices, "demand.prices")
    start = study.run.start or series.start
    grid = Grid.of(start, step_s, study.run.days or series.days_from(start, step_s))
    if choice.repeat:
        series = SampledSeries.from_pandas(prolonged(read, grid.end), choice.prices, "demand.prices")
    price = series.on(grid)
    forecast, files = _price_forecast(choice, grid, price)
    planner = _planner(study, choice, system, grid, forecast)
    notes = [
        f"prices: {choice.prices}, min / mean / max of the run "
        f"{price.min():.2f} / {price.mean():.2f} / {price.max():.2f} EUR/MWh",
        *repair_notes(read),
    ]
    return RunDemand(grid, ArbitrageSource(planner, system), price, [Path(choice.prices), *files], notes)


def _price_forecast(choice: ArbitrageDemand, grid: Grid, price: Array) -> tuple[Forecast, list[Path]]:
    """What is known of prices ahead, to the end of the run, and the file it was read from."""
    from bess.ems import Foretold, Perfect, Persistence
    from bess.market import read_prices

    if choice.forecast_prices is not None:
        read = read_prices(
            choice.forecast_prices, choice.zone, choice.product, time_zone=choice.time_zone, fill=choice.fill
        )
        foretold = SampledSeries.from_pandas(read, choice.forecast_prices, "demand.forecast_prices").on(grid)
        return Foretold(price, foretold), [Path(choice.forecast_prices)]
    return Perfect(price) if choice.forecast == "perfect" else Persistence(price, grid.dt_h), []


def _planner(
    study: Study, choice: ArbitrageDemand, system: System, grid: Grid, forecast: Forecast
) -> DispatchPlanner:
    from bess.ems import Arbitrage, AwareDispatch
    from bess.ems.arbitrage import calendar_days
    from bess.ems.forecast import steps_in

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
        dispatch = AwareDispatch(
            system,
            grid.dt_h,
            study.settlement.terms,
            max_power_kw=choice.max_power_kw,
            max_energy_kwh=choice.max_energy_kwh,
            cycles_per_day=choice.cycles_per_day,
            cycles_per_plan=choice.cycles_per_plan,
            end_price_eur_mwh=choice.end_price_eur_mwh,
        )
        return AwarePlanner(
            dispatch,
            forecast,
            days,
            look_ahead_steps=look_ahead,
            replan_steps=replan,
            compare_steps=max(1, round(COMPARE_H / grid.dt_h)),
            longest_steps=min(LONGEST_SHARE * look_ahead, LONGEST_H / grid.dt_h),
        )
    window = np.array([string.battery.soc_max - string.battery.soc_min for string in system.strings])
    energy_kwh = float((system.nominal_energy_kwh * window).sum())
    power_kw = float(system.nominal_kw.sum())
    arbitrage = Arbitrage(
        forecast,
        days,
        power_kw=min(power_kw, choice.max_power_kw or power_kw),
        energy_kwh=min(energy_kwh, choice.max_energy_kwh or energy_kwh),
        efficiency=choice.efficiency,
        cycles_per_day=choice.cycles_per_day,
        cycles_per_plan=choice.cycles_per_plan,
        look_ahead_h=choice.look_ahead_h,
        replan_h=COMPARE_H if choice.replan_h is None else choice.replan_h,
        dt_h=grid.dt_h,
    )
    return LinearPlanner(arbitrage)
