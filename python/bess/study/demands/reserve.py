"""Demands of kind ``fcr`` and ``fcr-arbitrage``: frequency containment reserve, with or without trade."""

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from bess.arrays import Array
from bess.dispatch import (
    Arbitrage,
    CycleBudget,
    EnergyWindow,
    ExternalForecast,
    Forecast,
    PerfectForecast,
    PersistenceForecast,
    RechargeScheduler,
    StorageEstimator,
    droop_response,
    reserve_blocks,
)
from bess.dispatch.arbitrage import calendar_days
from bess.dispatch.markets import four_hour_blocks
from bess.dispatch.synthetic import frequency_deviation, market_prices
from bess.display import rounded
from bess.errors import InputError
from bess.files import Fill
from bess.study.demands.source import (
    SYNTHETIC,
    DemandSection,
    DemandSource,
    Efficiency,
    RunDemand,
    Setting,
    StepInputs,
    padded,
    prices_of,
)
from bess.study.grid import SampledSeries, TimeGrid, seconds_of
from bess.study.keys import check_bundled
from bess.study.sections import TimeZone
from bess.system import State, System
from bess.system.quantities import Fraction, NonNegative, Positive, Price, within
from bess.units import PERCENT, SECONDS_PER_MINUTE

_FREQUENCY_STEP_S = 10
_PRICE_STEP_S = 3600
_BLOCK_H = 4.0
_RECHARGE_SHARE = 0.25
"""Recharge power, as a share of the reserve capacity; this part of the plant power is kept free for it."""


class FcrDemand(DemandSection):
    """Section ``[demand]`` with ``kind = "fcr"``: frequency containment reserve.

    ``frequency`` is ``synthetic``, a bundled week, or a file as :func:`bess.market.read_frequency` takes it;
    with ``repeat`` it begins at the start of the run and repeats. Power is proportional to the frequency
    deviation: ``capacity_kw`` at ``droop_mhz``, zero within ``dead_band_mhz``. The demand of a control step
    is the mean response. By default, a fifth of the plant power remains for recharging.

    The stored energy must sustain the full capacity for ``duration_min`` in each direction. Outside the
    central ``band`` of that window, the set-point is shifted by up to ``recharge_kw`` (by default a quarter
    of the capacity). Shifts have slots of ``recharge_slot_min``, are scheduled ``recharge_lead_min`` ahead,
    and include the round-trip ``efficiency``.

    The capacity price is ``capacity_prices``, a file as :func:`bess.market.read_capacity_prices` takes it
    (the column of ``country``), or ``capacity_price_eur_mw`` per four-hour block. Energy
    other than the response is settled at ``prices`` (a price file, or ``synthetic``, a bundled
    week) or, without, at ``energy_price_eur_mwh``.
    """

    files: ClassVar = ("frequency", "capacity_prices", "prices")

    kind: Literal["fcr"] = "fcr"
    frequency: str = SYNTHETIC
    column: str | None = None
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    capacity_kw: Positive | None = None
    droop_mhz: Positive = 200.0
    dead_band_mhz: NonNegative = 10.0
    duration_min: Annotated[float, within(0.0, 240.0, "min", above=True)] = 15.0
    band: Fraction = 0.5
    recharge_kw: NonNegative | None = None
    recharge_slot_min: Positive = 15.0
    recharge_lead_min: NonNegative = 15.0
    efficiency: Efficiency = 0.9
    capacity_prices: str | None = None
    country: str = "GERMANY"
    capacity_price_eur_mw: NonNegative = 65.0
    prices: str | None = None
    zone: str = "DE-LU"
    energy_price_eur_mwh: Price = 80.0
    forecast: Literal["expected", "persistence"] = "expected"

    def build(self, setting: Setting) -> RunDemand:
        """See :class:`~bess.study.demands.source.DemandSection`."""
        series = self._frequency(setting)
        grid, system = setting.grid_of(series), setting.system
        if self.repeat or self.frequency == SYNTHETIC:
            series = series.repeated(grid)
        capacity_kw, recharge_kw = self._powers(system)
        store = StorageEstimator(system, self.efficiency)
        band = self._window(capacity_kw, store, system).narrowed(self.band)
        share, averaging = self._response(series, grid)
        setting.note(f"reserve: {capacity_kw:g} kW, {averaging}")
        price = self._energy_price(setting, grid)
        capacity_price = self._capacity_price(setting, grid)
        sold_kw, trade, budget = self._sold(setting, grid, price, capacity_price, band)
        response_kw = sold_kw * share
        response: Forecast = ExternalForecast(response_kw, np.zeros(grid.n_steps))  # its mean is zero
        if self.forecast == "persistence":
            response = PersistenceForecast(response_kw, grid.dt_h)
        recharge = RechargeScheduler(
            recharge_kw,
            _steps(self.recharge_lead_min, "recharge_lead_min", grid, least=0),
            _steps(self.recharge_slot_min, "recharge_slot_min", grid, least=1),
            grid.dt_h,
            store.one_way_efficiency,
        )
        nominal_kw = float(system.nominal_kw.sum())
        source = ReserveSource(
            self, nominal_kw, capacity_kw, sold_kw, response, recharge, store, trade, budget
        )
        recorded = {"frequency_mhz": series.on(grid), "capacity_price_eur_mw_h": capacity_price}
        return RunDemand(grid, source, price, recorded)

    def _sold(
        self, setting: Setting, grid: TimeGrid, price: Array, capacity_price: Array, band: EnergyWindow
    ) -> tuple[Array, Arbitrage | None, CycleBudget | None]:
        """Return the reserve sold in each step [kW], and the dispatch of the other power and its budget."""
        return np.full(grid.n_steps, self._powers(setting.system)[0]), None, None

    def _powers(self, system: System) -> tuple[float, float]:
        """Capacity and recharge power [kW]."""
        trades, nominal_kw = self.trades, float(system.nominal_kw.sum())
        capacity_kw = self.capacity_kw or nominal_kw * (0.5 if trades else 1.0 / (1.0 + _RECHARGE_SHARE))
        recharge_kw = _RECHARGE_SHARE * capacity_kw if self.recharge_kw is None else self.recharge_kw
        together_kw = capacity_kw + recharge_kw
        if together_kw > nominal_kw * (1.0 + 1e-9) or (trades and together_kw >= nominal_kw):
            raise InputError(
                f"demand.capacity_kw = {capacity_kw:g} kW and demand.recharge_kw = {recharge_kw:g} kW leave "
                f"no power of the {nominal_kw:g} kW of the plant{' for trade' if trades else ''}; "
                "reduce the reserve"
            )
        return capacity_kw, recharge_kw

    def _window(self, capacity_kw: float, store: StorageEstimator, system: System) -> EnergyWindow:
        """Return the energy window of the reserve, which must not be empty."""
        capacity_kwh = store.capacity_kwh(system.initial_state())
        window = EnergyWindow.of(capacity_kw, self.duration_min, capacity_kwh, store.one_way_efficiency)
        if window.low_kwh >= window.high_kwh:
            raise InputError(
                f"demand.capacity_kw = {capacity_kw:g} kW for demand.duration_min = {self.duration_min:g} "
                f"min in either direction needs more than the {rounded(capacity_kwh, 4)} kWh of the plant; "
                "reduce the reserve"
            )
        return window

    def _frequency(self, setting: Setting) -> SampledSeries:
        """Return the frequency deviation; one that is repeated starts at the start of the run."""
        from bess.market import read_frequency

        file, key, start_s = self.frequency, "demand.frequency", seconds_of(setting.start)
        check_bundled(key, file, [SYNTHETIC])
        if file == SYNTHETIC:
            setting.note("frequency: a bundled week")
            return SampledSeries(frequency_deviation(), start_s, _FREQUENCY_STEP_S, "frequency", key)
        read = read_frequency(file, column=self.column, time_zone=self.time_zone, fill=self.fill)
        given = setting.series_of(read, file, key, "demand.repeat")
        setting.note(f"frequency: {file}", given)
        return replace(given, start_s=start_s) if self.repeat else given

    def _response(self, series: SampledSeries, grid: TimeGrid) -> tuple[Array, str]:
        """Return the mean activation in each step, and a note on the effect of averaging."""
        share = droop_response(series.values, self.droop_mhz, self.dead_band_mhz)
        mean = replace(series, values=share).on(grid)
        first = (grid.start_s - series.start_s) // series.step_s
        count = -(-grid.n_steps * grid.step_s // series.step_s)
        moved = float(np.abs(share[first : first + count]).mean())
        kept = PERCENT * float(np.abs(mean).mean()) / moved if moved > 0.0 else PERCENT
        return mean, (
            f"response by means over {grid.step_s / 60:g} min, which move {kept:.0f} % of the energy of "
            f"every {series.step_s} s"
        )

    def _energy_price(self, setting: Setting, grid: TimeGrid) -> Array:
        """Return the price of energy in each step [EUR/MWh]."""
        file, key = self.prices, "demand.prices"
        if file is None:
            return np.full(grid.n_steps, self.energy_price_eur_mwh)
        check_bundled(key, file, [SYNTHETIC])
        if file == SYNTHETIC:
            setting.note("prices: a bundled week")
            week = SampledSeries(market_prices(), 0, _PRICE_STEP_S, "the bundled week of prices", key)
            return week.on(grid, repeat=True)
        price = setting.series_of(prices_of(file, self.zone, time_zone=self.time_zone), file, key)
        setting.note(f"prices: {file}", price)
        return price.on(grid)

    def _capacity_price(self, setting: Setting, grid: TimeGrid) -> Array:
        """Return the price of reserve in each step [EUR/MW/h]."""
        from bess.market import read_capacity_prices

        file = self.capacity_prices
        if file is None:
            return np.full(grid.n_steps, self.capacity_price_eur_mw / _BLOCK_H)
        read = read_capacity_prices(file, self.country, time_zone=self.time_zone)
        price = setting.series_of(read, file, "demand.capacity_prices")
        setting.note(f"capacity prices: {file}", price)
        return price.on(grid)


class FcrArbitrageDemand(FcrDemand):
    """Section ``[demand]`` with ``kind = "fcr-arbitrage"``: trade with the power beside the reserve.

    The capacity (by default half of the plant power) and its energy are reserved at all times, with the keys
    of ``kind = "fcr"``. The remaining power, minus ``recharge_kw``, trades within the central ``band`` of the
    required window. Linear dispatch, as with ``plan = "linear"``, covers ``look_ahead_h`` and is re-optimised
    every ``replan_h``. With ``choose_capacity`` the reserve of each four-hour block is chosen the day before,
    up to ``capacity_kw``, together with the trade (:func:`bess.dispatch.reserve_blocks`), at known prices or
    those of the day before.
    """

    trades: ClassVar = True

    kind: Literal["fcr-arbitrage"] = "fcr-arbitrage"  # type: ignore[assignment]
    band: Fraction = 0.9
    choose_capacity: Literal["perfect", "persistence"] | None = None
    prices: str | None = SYNTHETIC
    market_time_zone: TimeZone = "Europe/Berlin"
    cycles_per_day: Positive = 1.0
    look_ahead_h: Positive = 36.0
    replan_h: Positive = 1.0

    def _sold(
        self, setting: Setting, grid: TimeGrid, price: Array, capacity_price: Array, band: EnergyWindow
    ) -> tuple[Array, Arbitrage | None, CycleBudget | None]:
        if self.band == 0.0:
            raise InputError("demand.band = 0: leaves no energy for trade; give more, up to 1")
        forecast, days = PerfectForecast(price), calendar_days(grid.index, self.market_time_zone)
        system, (capacity_kw, recharge_kw) = setting.system, self._powers(setting.system)
        power_kw = float(system.nominal_kw.sum()) - capacity_kw - recharge_kw
        store = StorageEstimator(system, self.efficiency)

        def size(state: State, limit_kw: Array) -> tuple[float, float]:
            """Return the power and energy for trade of the strings in service."""
            capacity_kwh = store.capacity_kwh(state, limit_kw=limit_kw)
            window = EnergyWindow.of(
                capacity_kw, self.duration_min, capacity_kwh, store.one_way_efficiency
            ).narrowed(self.band)
            return float(limit_kw.sum()) - capacity_kw - recharge_kw, window.high_kwh - window.low_kwh

        def trade(power_kw: float, reserved_kw: Array | float = 0.0) -> Arbitrage:
            """Return the linear dispatch in the band, with a part of the power sold as reserve."""
            return Arbitrage(
                forecast,
                days,
                power_kw=power_kw,
                energy_kwh=band.high_kwh - band.low_kwh,
                efficiency=self.efficiency,
                cycles_per_day=self.cycles_per_day,
                look_ahead_h=self.look_ahead_h,
                replan_h=self.replan_h,
                dt_h=grid.dt_h,
                reserved_kw=reserved_kw,
                fees_eur_mwh=setting.terms.fees_eur_mwh,
            )

        budget = setting.budget_of(
            grid, forecast, size, self.efficiency, self.look_ahead_h, self.cycles_per_day
        )
        if self.choose_capacity is None:
            return np.full(grid.n_steps, capacity_kw), trade(power_kw), budget
        stored_kwh = store.stored_kwh(system.initial_state())
        sold_kw = reserve_blocks(
            capacity_price,
            price,
            trade(power_kw + capacity_kw),
            blocks=four_hour_blocks(grid.index, self.market_time_zone),
            max_reserve_kw=capacity_kw,
            stored_kwh=max(0.0, stored_kwh - band.low_kwh),
            foresight=self.choose_capacity == "perfect",
        )
        return sold_kw, trade(power_kw + capacity_kw, sold_kw), budget


def _steps(minutes: float, key: str, grid: TimeGrid, least: int) -> int:
    """Return a time in control steps, rounded up to one, and at least ``least``."""
    steps = minutes * SECONDS_PER_MINUTE / grid.step_s
    if steps > 1.0 and abs(steps - round(steps)) > 1e-9:
        raise InputError(
            f"demand.{key} = {minutes:g} min must be a whole number of control steps of "
            f"{grid.step_s / 60:g} min"
        )
    return max(least, int(np.ceil(steps - 1e-9)))


@dataclass(eq=False)
class ReserveSource(DemandSource):
    """Frequency response, scheduled recharge, and optional trade; ``capacity_kw`` is sold in each step.

    The energy of ``max_capacity_kw`` is kept at all times: future sales are unknown.
    """

    _carried = ("recharge", "_plan", "_limit_kw", "_day", "_sold_kwh", "_recorded", "budget")

    choice: FcrDemand
    nominal_kw: float
    max_capacity_kw: float
    capacity_kw: Array
    response_kw: Forecast
    recharge: RechargeScheduler
    store: StorageEstimator
    trade: Arbitrage | None
    budget: CycleBudget | None
    _plan: Array = field(default_factory=lambda: np.zeros(0))
    _limit_kw: Array = field(default_factory=lambda: np.zeros(0))
    _day: int | None = None
    _sold_kwh: float = 0.0
    _recorded: dict[str, float] = field(default_factory=dict)

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        state, limit_kw = now.state, now.limit_kw
        stored_kwh = self.store.stored_kwh(state, limit_kw)
        capacity_kwh = self.store.capacity_kwh(state, limit_kw=limit_kw)
        if self.budget is not None:
            answered_kw = max(0.0, self._recorded.get("response_kw", 0.0))
            self.budget.advance(step, state, now.delivered_kw, answered_kw, limit_kw)
        capacity_kw = float(self.capacity_kw[step])
        window, largest = (
            EnergyWindow.of(each, self.choice.duration_min, capacity_kwh, self.store.one_way_efficiency)
            for each in (capacity_kw, self.max_capacity_kw)
        )
        band = largest.narrowed(self.choice.band)
        shift_kw = self.recharge.advance(step, stored_kwh, band, float(limit_kw.sum()))
        traded_kw = self._traded(step, limit_kw, stored_kwh, band)
        response_kw = self.response_kw.ahead(step, horizon)
        schedule_kw = padded(self.recharge.scheduled_kw[: horizon - 1], horizon - 1)
        schedule_kw = np.concatenate([[shift_kw], schedule_kw]) + padded(traded_kw[:horizon], horizon)
        free_kw = max(0.0, float(limit_kw.sum()) - abs(schedule_kw[0]))
        self._recorded = {
            "response_kw": float(response_kw[0]),
            "schedule_kw": float(schedule_kw[0]),
            "capacity_kw": capacity_kw,
            "capacity_able_kw": min(free_kw, window.sustainable_kw(capacity_kw, stored_kwh, capacity_kwh)),
            "soc_low": self.store.soc_at(state, window.low_kwh, limit_kw),
            "soc_high": self.store.soc_at(state, window.high_kwh, limit_kw),
        }
        demand_kw = padded(response_kw, horizon) + schedule_kw
        if self.budget is None:
            return demand_kw
        allowed_kw = self.budget.limited(demand_kw)
        if allowed_kw[0] != demand_kw[0]:
            self._recorded["capacity_able_kw"] = 0.0
        self._recorded |= self.budget.recorded()
        return allowed_kw

    def _traded(self, step: int, limit_kw: Array, stored_kwh: float, band: EnergyWindow) -> Array:
        """Return the planned trade of this step and the next ones."""
        if self.trade is None:
            return np.zeros(0)
        day = int(self.trade.days[step])
        if day != self._day:
            self._day, self._sold_kwh = day, 0.0
        self._plan = self._plan[1:]
        if self.trade.is_due(step) or not np.array_equal(limit_kw, self._limit_kw):
            budget = {} if self.budget is None else self.budget.for_plan()
            self._limit_kw, out_kw = limit_kw, self.nominal_kw - float(limit_kw.sum())
            self._plan = self.trade.plan(
                step,
                stored_kwh - band.low_kwh,
                self._sold_kwh,
                available_kw=self.trade.power_kw - out_kw,
                available_kwh=max(0.0, band.high_kwh - band.low_kwh),
                **budget,
            )
        self._sold_kwh += max(0.0, float(self._plan[0])) * self.trade.dt_h / self.store.one_way_efficiency
        return self._plan

    def planned(self, step: int) -> dict[str, float]:
        """Return response, schedule and reserve of the step of the last :meth:`ahead` call."""
        return self._recorded
