"""Demand of grid services and of a site behind a meter: sources in each step, and their builders."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bess.arrays import Array
from bess.dispatch import (
    SITES,
    Arbitrage,
    CycleBudget,
    EnergyWindow,
    Forecast,
    GridPowerTarget,
    PeakTariff,
    PerfectForecast,
    PersistenceForecast,
    RechargeScheduler,
    StorageEstimator,
    droop_response,
    min_peak_kw,
    reserve_blocks,
)
from bess.dispatch.arbitrage import calendar_days
from bess.dispatch.connection import QUARTER_S
from bess.dispatch.synthetic import frequency_deviation, market_prices
from bess.errors import InputError
from bess.simulation.demand import DemandSource, StepInputs, padded
from bess.simulation.run_demand import (
    DEFAULT_START,
    RunDemand,
    budget_of,
    forecast_of,
    power_series,
    repair_notes,
    utc_index,
)
from bess.study.demands import (
    SYNTHETIC,
    FcrArbitrageDemand,
    FcrDemand,
    MeterSection,
    PeakShavingDemand,
    SiteDemand,
)
from bess.study.grid import SampledSeries, TimeGrid, seconds_of
from bess.study.keys import check_bundled
from bess.study.study import Study
from bess.system import System
from bess.units import PERCENT


class ZeroResponseForecast:
    """Forecast of a frequency response: the measured value in this step, and zero (the mean) in later steps.

    Parameters
    ----------
    values : ndarray, shape (n_steps,)
        Actual response [kW].
    """

    def __init__(self, values: Array) -> None:
        self._values = values

    def ahead(self, step: int, horizon: int) -> Array:
        """See :class:`bess.dispatch.Forecast`."""
        seen = np.zeros(min(horizon, self._values.size - step))
        seen[0] = self._values[step]
        return seen


class MeterSource(DemandSource):
    """A battery that keeps the power at the meter at a target (:class:`~bess.dispatch.GridPowerTarget`)."""

    demand_depends_on_soc = True
    _carried = ("_store",)

    def __init__(
        self,
        net_kw: Forecast,
        target: GridPowerTarget,
        target_kw: Array,
        store: StorageEstimator,
        ready_soc: float,
    ) -> None:
        self._net_kw, self._target, self._target_kw = net_kw, target, target_kw
        self._store, self._ready_soc = store, ready_soc

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`bess.simulation.demand.DemandSource`."""
        state = now.state
        self._store.update(state, now.delivered_kw * self._target.dt_h)
        net_kw = self._net_kw.ahead(step, horizon)
        target = replace(
            self._target,
            target_kw=self._target_kw[step : step + net_kw.size],
            one_way_efficiency=self._store.one_way_efficiency,
            power_kw=min(self._target.power_kw, float(now.limit_kw.sum())),
            capacity_kwh=self._store.capacity_kwh(state, self._ready_soc),
        )
        return padded(target.demand_kw(net_kw, self._store.stored_kwh(state)), horizon)


@dataclass(frozen=True)
class Reserve:
    """Sold reserve.

    Attributes
    ----------
    capacity_kw : ndarray, shape (n_steps,)
        Symmetric reserve.
    duration_min : float
        Duration for which the full reserve must be sustained.
    band : float
        Share of the required window without recharge.
    """

    capacity_kw: Array
    duration_min: float
    band: float


class ReserveSource(DemandSource):
    """Frequency response, scheduled recharge, and optional trade."""

    _carried = ("_recharge", "_plan", "_day", "_sold_kwh", "_said", "_budget")

    def __init__(
        self,
        response_kw: Forecast,
        reserve: Reserve,
        recharge: RechargeScheduler,
        store: StorageEstimator,
        trade: Arbitrage | None,
        budget: CycleBudget | None = None,
    ) -> None:
        self._response_kw, self._reserve, self._store = response_kw, reserve, store
        self._recharge, self._trade, self._budget = recharge, trade, budget
        self._max_capacity_kw = float(reserve.capacity_kw.max())
        self._plan: Array = np.zeros(0)
        self._day: int | None = None
        self._sold_kwh = 0.0
        self._said: dict[str, float] = {}

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`bess.simulation.demand.DemandSource`."""
        stored_kwh, capacity_kwh = self._store.stored_kwh(now.state), self._store.capacity_kwh(now.state)
        if self._budget is not None:
            answered_kw = max(0.0, self._said.get("response_kw", 0.0))
            self._budget.advance(step, now.state.soc, now.delivered_kw, answered_kw)
        capacity_kw = float(self._reserve.capacity_kw[step])
        window, largest = (
            EnergyWindow.of(each, self._reserve.duration_min, capacity_kwh, self._store.one_way_efficiency)
            for each in (capacity_kw, self._max_capacity_kw)
        )
        band = largest.narrowed(self._reserve.band)
        shift_kw = self._recharge.advance(step, stored_kwh, band)
        traded_kw = self._traded(step, stored_kwh, band)
        response_kw = self._response_kw.ahead(step, horizon)
        schedule_kw = padded(self._recharge.scheduled_kw[: horizon - 1], horizon - 1)
        schedule_kw = np.concatenate([[shift_kw], schedule_kw]) + padded(traded_kw[:horizon], horizon)
        free_kw = max(0.0, float(now.limit_kw.sum()) - abs(schedule_kw[0]))
        self._said = {
            "response_kw": float(response_kw[0]),
            "schedule_kw": float(schedule_kw[0]),
            "capacity_kw": capacity_kw,
            "capacity_able_kw": min(free_kw, window.sustainable_kw(capacity_kw, stored_kwh, capacity_kwh)),
            "soc_low": self._store.soc_at(now.state, window.low_kwh),
            "soc_high": self._store.soc_at(now.state, window.high_kwh),
        }
        demand_kw = padded(response_kw, horizon) + schedule_kw
        if self._budget is None:
            return demand_kw
        allowed_kw = self._budget.limited(demand_kw, self._store.smallest_kwh(now.state))
        if allowed_kw[0] != demand_kw[0]:
            self._said["capacity_able_kw"] = 0.0
        self._said |= self._budget.recorded()
        return allowed_kw

    def _traded(self, step: int, stored_kwh: float, band: EnergyWindow) -> Array:
        """Return the planned trade of this step and the next ones."""
        if self._trade is None:
            return np.zeros(0)
        day = int(self._trade.days[step])
        if day != self._day:
            self._day, self._sold_kwh = day, 0.0
        self._plan = self._plan[1:]
        if self._trade.is_due(step):
            budget = self._budget
            price, left = (0.0, np.inf) if budget is None else (budget.price_eur_mwh, budget.remaining_kwh)
            self._plan = self._trade.plan(
                step,
                stored_kwh - band.low_kwh,
                self._sold_kwh,
                budget_price_eur_mwh=price,
                remaining_kwh=left,
            )
        self._sold_kwh += max(0.0, float(self._plan[0])) * self._trade.dt_h / self._store.one_way_efficiency
        return self._plan

    def planned(self, step: int) -> dict[str, float]:
        """Return response, schedule and reserve of the step of the last :meth:`ahead` call."""
        return self._said


@dataclass(frozen=True)
class Site:
    """Load and generation behind the meter of a plant.

    Attributes
    ----------
    grid : TimeGrid
        Control steps of the run.
    net_kw : ndarray
        Load minus generation of the run and, as far as known, of one horizon after its end.
    forecast : Forecast
        Forecast of ``net_kw``.
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
    """Read load and generation; without ``grid``, the load determines the time span of the run."""
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


_FREQUENCY_STEP_S = 10
_HOUR_S = 3600
_BLOCK_H = 4.0
_RECHARGE_SHARE = 0.25
"""Recharge power, as a share of the reserve capacity; this part of the plant power is kept free for it."""
_MIN_SHARE = 0.03
"""Minimum power, as a share of plant power: lower powers do not justify the no-load loss of an inverter."""
_SECONDS_PER_MINUTE = 60.0


def reserve_of(study: Study, choice: FcrDemand, system: System, step_s: float) -> RunDemand:
    """Frequency containment reserve, with or without trade."""
    series, files, notes = _frequency(study, choice)
    start = study.run.start or series.start
    grid = TimeGrid.of(start, step_s, study.run.days or series.days_from(start, step_s))
    trades = isinstance(choice, FcrArbitrageDemand)
    capacity_kw, recharge_kw = _powers(choice, float(system.nominal_kw.sum()), trades=trades)
    store = StorageEstimator(system, choice.efficiency)
    band = _window(choice, capacity_kw, store, system).narrowed(choice.band)

    frequency_mhz, share, averaging = _response(series, choice, grid)
    price, price_files, price_notes = _energy_price(choice, grid)
    capacity_price, capacity_files, capacity_notes = _capacity_price(choice, grid)
    trade, budget = None, None
    sold_kw = np.full(grid.n_steps, capacity_kw)
    if isinstance(choice, FcrArbitrageDemand):
        power_kw = float(system.nominal_kw.sum()) - capacity_kw - recharge_kw
        trade = _trade(choice, grid, price, power_kw, band)
        if choice.choose_capacity is not None:
            sold_kw = reserve_blocks(
                capacity_price,
                price,
                _trade(choice, grid, price, power_kw + capacity_kw, band),
                max_reserve_kw=capacity_kw,
                stored_kwh=max(0.0, store.stored_kwh(system.initial_state()) - band.low_kwh),
                foresight=choice.choose_capacity == "perfect",
            )
            trade = _trade(choice, grid, price, power_kw + capacity_kw, band, sold_kw)
    asked_kw = sold_kw * share
    response: Forecast = ZeroResponseForecast(asked_kw)
    if choice.forecast == "persistence":
        response = PersistenceForecast(asked_kw, grid.dt_h)
    recharge = RechargeScheduler(
        recharge_kw,
        _steps(choice.recharge_lead_min, "recharge_lead_min", grid, least=0),
        _steps(choice.recharge_slot_min, "recharge_slot_min", grid, least=1),
        grid.dt_h,
        store.one_way_efficiency,
    )
    if isinstance(choice, FcrArbitrageDemand):
        size = power_kw, band.high_kwh - band.low_kwh
        budget = budget_of(
            study.budget, system, grid, PerfectForecast(price), size, choice.efficiency, choice.look_ahead_h
        )
    reserve = Reserve(sold_kw, choice.duration_min, choice.band)
    return RunDemand(
        grid,
        ReserveSource(response, reserve, recharge, store, trade, budget),
        price,
        [*files, *price_files, *capacity_files],
        [*notes, f"reserve: {capacity_kw:g} kW, {averaging}", *price_notes, *capacity_notes],
        {"frequency_mhz": frequency_mhz, "capacity_price_eur_mw_h": capacity_price},
    )


def site_of(study: Study, choice: SiteDemand, system: System, step_s: float, horizon: int) -> RunDemand:
    """A load, and optionally generation, behind one meter with the plant."""
    site = site_of_meter(study, choice, step_s, horizon)
    grid, net_kw, dt_h = site.grid, site.net_kw, site.grid.dt_h
    store = StorageEstimator(system, choice.efficiency)
    state, power_kw = system.initial_state(), float(system.nominal_kw.sum())
    series = site.series | {"export_price_eur_mwh": np.full(grid.n_steps, choice.export_price_eur_mwh)}
    target_kw = np.zeros(grid.n_steps)
    capacity_kwh = store.capacity_kwh(state, choice.ready_soc)
    if isinstance(choice, PeakShavingDemand):
        if choice.limit_kw is None:
            target_kw = min_peak_kw(
                net_kw[: grid.n_steps],
                dt_h,
                power_kw=power_kw,
                capacity_kwh=capacity_kwh,
                stored_kwh=store.stored_kwh(state),
                one_way_efficiency=store.one_way_efficiency,
                month=0 if site.tariff is None else site.tariff.month,
            )
        else:
            target_kw = np.full(grid.n_steps, choice.limit_kw)
        series["grid_limit_kw"] = target_kw
        if site.tariff is None:
            series["demand_charge_eur_kw_h"] = np.full(
                grid.n_steps, choice.demand_charge_eur_kw_year / 8760.0
            )
        found = "as given" if choice.limit_kw else "the minimum with perfect forecast"
        limits = " and ".join(f"{each:.4g}" for each in dict.fromkeys(target_kw.tolist()))
        site.notes.append(f"limit of the grid connection: {limits} kW, {found}")
    later = np.full(net_kw.size - grid.n_steps, target_kw[-1])
    target = GridPowerTarget(
        0.0, power_kw, capacity_kwh, store.one_way_efficiency, dt_h, _MIN_SHARE * power_kw
    )
    price = np.full(grid.n_steps, choice.price_eur_mwh)
    source = MeterSource(site.forecast, target, np.r_[target_kw, later], store, choice.ready_soc)
    return RunDemand(grid, source, price, site.files, site.notes, series)


def _powers(choice: FcrDemand, nominal_kw: float, *, trades: bool) -> tuple[float, float]:
    """Capacity and recharge power [kW]."""
    capacity_kw = choice.capacity_kw or nominal_kw * (0.5 if trades else 1.0 / (1.0 + _RECHARGE_SHARE))
    recharge_kw = _RECHARGE_SHARE * capacity_kw if choice.recharge_kw is None else choice.recharge_kw
    together_kw = capacity_kw + recharge_kw
    if together_kw > nominal_kw * (1.0 + 1e-9) or (trades and together_kw >= nominal_kw):
        raise InputError(
            f"demand.capacity_kw = {capacity_kw:g} kW and demand.recharge_kw = {recharge_kw:g} kW leave "
            f"no power of the {nominal_kw:g} kW of the plant{' for trade' if trades else ''}; "
            "reduce the reserve"
        )
    return capacity_kw, recharge_kw


def _window(choice: FcrDemand, capacity_kw: float, store: StorageEstimator, system: System) -> EnergyWindow:
    """Return the energy window of the reserve, which must not be empty."""
    capacity_kwh = store.capacity_kwh(system.initial_state())
    window = EnergyWindow.of(capacity_kw, choice.duration_min, capacity_kwh, store.one_way_efficiency)
    if window.low_kwh >= window.high_kwh:
        raise InputError(
            f"demand.capacity_kw = {capacity_kw:g} kW for demand.duration_min = {choice.duration_min:g} min "
            f"in either direction needs more than the {capacity_kwh:.4g} kWh of the plant; reduce the reserve"
        )
    return window


def _frequency(study: Study, choice: FcrDemand) -> tuple[SampledSeries, list[Path], list[str]]:
    """Return the frequency deviation; a repeated series starts at the start of the run."""
    from bess.market import read_frequency

    start = study.run.start or DEFAULT_START
    check_bundled("demand.frequency", choice.frequency, [SYNTHETIC])
    if choice.frequency == SYNTHETIC:
        values, step_s, files, notes = (
            frequency_deviation(),
            _FREQUENCY_STEP_S,
            [],
            ["frequency: a bundled week"],
        )
    else:
        read = read_frequency(
            choice.frequency, column=choice.column, time_zone=choice.time_zone, fill=choice.fill
        )
        given = SampledSeries.from_pandas(read, choice.frequency, "demand.frequency")
        files, notes = [Path(choice.frequency)], [f"frequency: {choice.frequency}", *repair_notes(read)]
        if not choice.repeat:
            return given, files, notes
        values, step_s = given.values, given.step_s
    period_days = values.size * step_s / 86_400.0
    count = int(np.ceil((study.run.days or period_days) / period_days))
    return (
        SampledSeries(np.tile(values, count), seconds_of(start), step_s, "frequency", "demand.frequency"),
        files,
        notes,
    )


def _response(series: SampledSeries, choice: FcrDemand, grid: TimeGrid) -> tuple[Array, Array, str]:
    """Return the mean deviation and activation in each step, and a note on the effect of averaging."""
    share = droop_response(series.values, choice.droop_mhz, choice.dead_band_mhz)
    mean = SampledSeries(share, series.start_s, series.step_s, series.what, series.key).on(grid)
    first = (grid.start_s - series.start_s) // series.step_s
    count = -(-grid.n_steps * grid.step_s // series.step_s)
    moved = float(np.abs(share[first : first + count]).mean())
    kept = PERCENT * float(np.abs(mean).mean()) / moved if moved > 0.0 else PERCENT
    said = (
        f"response by means over {grid.step_s / 60:g} min, which move {kept:.0f} % of the energy of every "
        f"{series.step_s} s"
    )
    return series.on(grid), mean, said


def _energy_price(choice: FcrDemand, grid: TimeGrid) -> tuple[Array, list[Path], list[str]]:
    from bess.market import read_prices

    if choice.prices is None:
        return np.full(grid.n_steps, choice.energy_price_eur_mwh), [], []
    check_bundled("demand.prices", choice.prices, [SYNTHETIC])
    if choice.prices == SYNTHETIC:
        hours = grid.start_s // _HOUR_S + np.arange(-(-grid.n_steps * grid.step_s // _HOUR_S) + 1)
        values = market_prices()[hours % market_prices().size]
        first_s = grid.start_s // _HOUR_S * _HOUR_S
        week = SampledSeries(values, first_s, _HOUR_S, "the bundled week of prices", "demand.prices")
        return week.on(grid), [], ["prices: a bundled week"]
    read = read_prices(choice.prices, choice.zone)
    price = SampledSeries.from_pandas(read, choice.prices, "demand.prices").on(grid)
    return price, [Path(choice.prices)], [f"prices: {choice.prices}", *repair_notes(read)]


def _capacity_price(choice: FcrDemand, grid: TimeGrid) -> tuple[Array, list[Path], list[str]]:
    """Return the price of reserve in each step [EUR/MW/h]."""
    from bess.market import read_capacity_prices

    if choice.capacity_prices is None:
        return np.full(grid.n_steps, choice.capacity_price_eur_mw / _BLOCK_H), [], []
    read = read_capacity_prices(choice.capacity_prices, choice.country)
    price = SampledSeries.from_pandas(read, choice.capacity_prices, "demand.capacity_prices").on(grid)
    return price, [Path(choice.capacity_prices)], [f"capacity prices: {choice.capacity_prices}"]


def _trade(
    choice: FcrArbitrageDemand,
    grid: TimeGrid,
    price: Array,
    power_kw: float,
    band: EnergyWindow,
    reserved_kw: Array | float = 0.0,
) -> Arbitrage:
    return Arbitrage(
        PerfectForecast(price),
        calendar_days(utc_index(grid), choice.market_time_zone),
        power_kw=power_kw,
        energy_kwh=band.high_kwh - band.low_kwh,
        efficiency=choice.efficiency,
        cycles_per_day=choice.cycles_per_day,
        look_ahead_h=choice.look_ahead_h,
        replan_h=choice.replan_h,
        dt_h=grid.dt_h,
        reserved_kw=reserved_kw,
    )


def _steps(minutes: float, key: str, grid: TimeGrid, least: int) -> int:
    """Return a time in control steps; a time shorter than a step gives ``least``."""
    steps = minutes * _SECONDS_PER_MINUTE / grid.step_s
    if steps > 1.0 and abs(steps - round(steps)) > 1e-9:
        raise InputError(
            f"demand.{key} = {minutes:g} min must be a whole number of control steps of "
            f"{grid.step_s / 60:g} min"
        )
    return max(least, int(np.ceil(steps - 1e-9)))
