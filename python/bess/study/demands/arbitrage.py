"""Demand of kind ``arbitrage``: trade at the prices of a market file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import model_validator

from bess.arrays import Array
from bess.dispatch import (
    Arbitrage,
    BandForecast,
    CycleBudget,
    DynamicProgramDispatch,
    ExternalForecast,
    Forecast,
    GridConnection,
    PerfectForecast,
    PersistenceForecast,
    StorageEstimator,
    auction_positions,
)
from bess.dispatch.aggregate import counted
from bess.dispatch.arbitrage import calendar_days
from bess.dispatch.forecast import price_ends_of, steps_in
from bess.dispatch.markets import AuctionForecast
from bess.errors import InputError, placed
from bess.files import Fill
from bess.study.demands.planners import COMPARE_H, AwarePlanner, LinearPlanner, MarketPlan, nominal_stored_kwh
from bess.study.demands.site import MeterSection, site_of
from bess.study.demands.source import (
    DemandSection,
    DemandSource,
    Efficiency,
    RunDemand,
    Setting,
    StepInputs,
    padded,
    prices_of,
)
from bess.study.grid import SampledSeries, TimeGrid
from bess.study.sections import RunName, TimeZone
from bess.system import State, System
from bess.system.quantities import NonNegative, Positive, within
from bess.system.section import Section

QUANTILE_COLUMNS = ("p10", "p50", "p90")
"""Columns of a file of price bands."""
HISTORY_DAYS = 30
"""Number of days before a run whose prices a forecast uses, if the file contains them."""


class MarketSection(Section):
    """Section ``[[demand.market]]``: an auction of a whole day, which the last market trades again.

    The auctions are in the order of their gates; a product is one control step or longer, and no longer than
    that of the auction before. Files are read as those of ``demand.prices``, by default the same file.
    """

    name: RunName
    prices: str | None = None
    product: str | None = None
    step_min: Annotated[float, within(1.0, 1440.0, "min")] = 60.0


class TradeMeterSection(MeterSection):
    """Section ``[demand.meter]`` of ``kind = "arbitrage"``: trade behind a meter with load or generation.

    Import costs the market price plus ``import_fee_eur_mwh``, export earns the market price.
    ``max_import_kw`` and ``max_export_kw`` hold at the meter: generation above the limit of the export is
    curtailed unless the plant charges it.
    """

    import_fee_eur_mwh: NonNegative = 0.0


class ArbitrageDemand(DemandSection):
    """Section ``[demand]`` with ``kind = "arbitrage"``: trade at the prices of a market file.

    ``plan`` is ``aware`` (:class:`bess.dispatch.DynamicProgramDispatch`, on the plant model) or ``linear``
    (:class:`bess.dispatch.Arbitrage`, with a constant ``efficiency``). ``cycles_per_plan`` replaces the limit
    ``cycles_per_day`` by a limit for each plan, on the mean of charged and discharged energy (AC). Without
    ``end_price_eur_mwh``, stored energy at the end of an aware plan has the median purchase price, or the
    revenue from the best tenth of prices if that is less. Without ``replan_h``, a linear plan is re-optimised
    every 3 h; an aware plan after a sixth of its length or 6 h, and when inverters in service, price
    forecast, stored energy or temperature deviate from it (compared every 3 h, inverters in every step).

    ``forecast = "bands"`` plans with several levels of each price (:class:`bess.dispatch.BandForecast`), from
    columns ``p10``, ``p50`` and ``p90`` of ``forecast_prices`` or from measured errors of persistence;
    ``"expected"``, and a linear plan, use their mean. Policies have the same forecast. Actual prices are
    settled. ``meter`` is load and generation behind the same meter, for linear plans
    (:class:`bess.dispatch.GridConnection`). Each ``market`` is an auction before the market of ``prices``
    (:func:`bess.dispatch.auction_positions`).
    """

    files: ClassVar = ("prices", "forecast_prices", "meter.load", "meter.pv", "market.*.prices")
    trades: ClassVar = True

    kind: Literal["arbitrage"] = "arbitrage"
    prices: str | None = None
    zone: str = "DE-LU"
    product: str | None = None
    time_zone: str | None = None
    fill: Fill | None = None
    market_time_zone: TimeZone = "Europe/Berlin"
    max_power_kw: Positive | None = None
    max_energy_kwh: Positive | None = None
    max_import_kw: Positive | None = None
    max_export_kw: Positive | None = None
    plan: Literal["aware", "linear"] = "aware"
    efficiency: Efficiency = 0.9
    cycles_per_day: Positive = 2.0
    cycles_per_plan: Positive | None = None
    end_price_eur_mwh: NonNegative | None = None
    look_ahead_h: Positive = 36.0
    replan_h: Positive | None = None
    repeat: bool = False
    forecast: Literal["perfect", "persistence", "file", "expected", "bands"] = "perfect"
    forecast_prices: str | None = None
    meter: TradeMeterSection | None = None
    market: tuple[MarketSection, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.forecast == "file" and self.forecast_prices is None:
            raise ValueError('forecast = "file" needs forecast_prices')
        if self.forecast in ("perfect", "persistence") and self.forecast_prices is not None:
            raise ValueError('forecast_prices needs forecast = "file", "expected" or "bands"')
        if self.market and self.meter is not None:
            raise ValueError("market: positions of several markets are not settled behind a meter")
        if any(later.step_min > earlier.step_min for earlier, later in pairwise(self.market)):
            raise ValueError("market: a later auction must not have longer products than an earlier one")
        if self.meter is not None and self.plan != "linear":
            raise ValueError('meter: only plan = "linear" supports load and generation behind a meter')
        if self.replan_h is not None and self.replan_h > self.look_ahead_h:
            raise ValueError(
                f"replan_h {self.replan_h:g} h must not exceed look_ahead_h {self.look_ahead_h:g} h"
            )
        return self

    def build(self, setting: Setting) -> RunDemand:
        """See :class:`~bess.study.demands.source.DemandSection`.

        Raises
        ------
        InputError
            As there, or the study names no price file.
        """
        file, key = self.prices, "demand.prices"
        if file is None:
            raise InputError(
                "demand.prices is not set: name a price file (SMARD, Energy-Charts or ENTSO-E export), "
                "such as demand.prices = FILE.csv"
            )
        given = self._prices(setting, file, key, self.product)
        grid = setting.grid_of(given)
        prices = self._prices(setting, file, key, self.product, grid)
        price = prices.on(grid)
        forecast = self._price_forecast(setting, grid, prices)
        span = f"{price.min():.2f} / {price.mean():.2f} / {price.max():.2f} EUR/MWh"
        setting.note(f"prices: {file}, min / mean / max of the run {span}", given)
        connection, fee_eur_mwh = None, 0.0
        series: dict[str, Array] = {}
        if self.meter is not None:
            site = site_of(self.meter, setting, grid)
            fee_eur_mwh = self.meter.import_fee_eur_mwh
            connection = GridConnection(
                site.forecast,
                grid.dt_h,
                max_import_kw=self.max_import_kw or np.inf,
                max_export_kw=self.max_export_kw or np.inf,
                import_fee_eur_mwh=fee_eur_mwh,
                tariff=site.tariff,
            )
            series = site.series | {"export_price_eur_mwh": price}
            if self.max_export_kw is not None:
                series["export_limit_kw"] = np.full(grid.n_steps, self.max_export_kw)
        if self.market:
            series = self._auctions(file, setting, grid, price)
            if self.forecast == "persistence":
                days = calendar_days(grid.index, self.market_time_zone)
                auction = series["auction_price_eur_mwh"][:, -1]
                forecast = AuctionForecast(price, auction, days, grid.dt_h)
        planner = self._planner(setting, grid, forecast, connection)
        budget = setting.budget_of(
            grid,
            forecast,
            partial(self._size, setting.system),
            self.efficiency,
            self.look_ahead_h,
            self.cycles_per_day if self.cycles_per_plan is None else None,
            planner.wear_eur_mwh,
        )
        source = ArbitrageSource(planner, setting.system, budget, connection)

        def price_ahead(step: int, horizon: int) -> Array:
            return forecast.ahead(step, horizon) + fee_eur_mwh

        return RunDemand(grid, source, price + fee_eur_mwh, series, price_ahead)

    def _prices(
        self,
        setting: Setting,
        file: str,
        key: str,
        product: str | None,
        grid: TimeGrid | None = None,
        zone: str | None = None,
    ) -> SampledSeries:
        """Return the prices in ``file``; with ``repeat`` they last to the end of ``grid``."""
        from bess.market import extended

        read = prices_of(file, zone or self.zone, product, time_zone=self.time_zone, fill=self.fill)
        if self.repeat and grid is not None:
            read = extended(read, grid.end)
        return setting.series_of(read, file, key, "demand.repeat")

    def _auctions(self, last_file: str, setting: Setting, grid: TimeGrid, price: Array) -> dict[str, Array]:
        """Positions and prices of the auctions before the last market, as recorded series."""
        prices, steps = [], []
        for number, market in enumerate(self.market):
            key, file = f"demand.market.{number}", market.prices or last_file
            prices.append(self._prices(setting, file, f"{key}.prices", market.product, grid).on(grid))
            steps.append(steps_in(market.step_min / 60.0, grid.dt_h, f"{key}.step_min"))
        state = setting.system.initial_state()
        planner = self._linear(setting.system, grid, PerfectForecast(price), state=state, replan_h=grid.dt_h)
        stored_kwh = StorageEstimator(setting.system, self.efficiency).stored_kwh(state)
        position_kw = auction_positions(
            [*prices, price],
            planner,
            product_steps=steps,
            stored_kwh=min(planner.energy_kwh, stored_kwh),
            foresight=self.forecast == "perfect",
        )
        return {"position_kw": position_kw, "auction_price_eur_mwh": np.stack(prices, axis=1)}

    def _price_forecast(self, setting: Setting, grid: TimeGrid, series: SampledSeries) -> Forecast:
        """Return the price forecast to the end of the run."""
        if self.forecast == "perfect":
            return PerfectForecast(series.on(grid))
        file = self.forecast_prices
        if file is None:
            # Prices of the file before the run are known.
            before = max(
                0, min((grid.start_s - series.start_s) // grid.step_s, round(HISTORY_DAYS * 24 / grid.dt_h))
            )
            price = series.on(grid.earlier(before))
            kind = PersistenceForecast if self.forecast == "persistence" else BandForecast
            return kind(price, grid.dt_h, price_ends=price_ends_of(price, grid.dt_h), first=before)

        def forecast_of(zone: str) -> Array:
            key = "demand.forecast_prices"
            return self._prices(setting, file, key, self.product, grid, zone).on(grid)

        price = series.on(grid)
        ends = price_ends_of(price, grid.dt_h)
        if self.forecast == "file":
            return ExternalForecast(price, forecast_of(self.zone), price_ends=ends)
        bands = np.stack([forecast_of(zone) for zone in QUANTILE_COLUMNS])
        with placed(f"demand.forecast_prices {file}"):
            return BandForecast(price, grid.dt_h, bands, price_ends=ends)

    def _planner(
        self,
        setting: Setting,
        grid: TimeGrid,
        forecast: Forecast,
        connection: GridConnection | None,
    ) -> LinearPlanner | AwarePlanner:
        if self.plan == "linear":
            arbitrage = self._linear(
                setting.system,
                grid,
                forecast,
                connection,
                cycles_per_plan=self.cycles_per_plan,
                replan_h=self.replan_h or COMPARE_H,
                fees_eur_mwh=setting.terms.fees_eur_mwh,
            )
            return LinearPlanner(arbitrage, setting.system)
        dispatch = DynamicProgramDispatch(
            setting.system,
            grid.dt_h,
            setting.terms,
            max_power_kw=self.max_power_kw,
            max_energy_kwh=self.max_energy_kwh,
            max_import_kw=self.max_import_kw,
            max_export_kw=self.max_export_kw,
            cycles_per_day=self.cycles_per_day,
            cycles_per_plan=self.cycles_per_plan,
            end_price_eur_mwh=self.end_price_eur_mwh,
        )
        dt_h, replan_h = grid.dt_h, self.replan_h
        return AwarePlanner(
            dispatch,
            forecast,
            calendar_days(grid.index, self.market_time_zone),
            dt_h,
            replan_steps=None if replan_h is None else steps_in(replan_h, dt_h, "demand.replan_h"),
            look_ahead_steps=steps_in(self.look_ahead_h, dt_h, "demand.look_ahead_h"),
            bands=forecast if self.forecast == "bands" and isinstance(forecast, BandForecast) else None,
        )

    def _linear(
        self,
        system: System,
        grid: TimeGrid,
        prices: Forecast,
        connection: GridConnection | None = None,
        state: State | None = None,
        **more: Any,
    ) -> Arbitrage:
        """Return the linear dispatch of the section; ``more`` are further arguments of it."""
        power_kw, energy_kwh = self._size(system, state)
        return Arbitrage(
            prices,
            calendar_days(grid.index, self.market_time_zone),
            power_kw=power_kw,
            energy_kwh=energy_kwh,
            efficiency=self.efficiency,
            cycles_per_day=self.cycles_per_day,
            # Behind a meter the connection has the limits.
            max_import_kw=self.max_import_kw if connection is None else None,
            max_export_kw=self.max_export_kw if connection is None else None,
            look_ahead_h=self.look_ahead_h,
            dt_h=grid.dt_h,
            connection=connection,
            **more,
        )

    def _size(
        self, system: System, state: State | None = None, limit_kw: Array | float = np.inf
    ) -> tuple[float, float]:
        """Return the power [kW] and energy [kWh] available for trading; without a state, those when new."""
        limit_kw, (low, high) = np.minimum(limit_kw, system.nominal_kw), system.soc_window
        string_kwh = system.nominal_energy_kwh * (high - low) * (1.0 if state is None else state.soh_capacity)
        power_kw, energy_kwh = float(limit_kw.sum()), float(string_kwh[counted(limit_kw)].sum())
        return min(power_kw, self.max_power_kw or power_kw), min(
            energy_kwh, self.max_energy_kwh or energy_kwh
        )


@dataclass(eq=False)
class ArbitrageSource(DemandSource):
    """A dispatch plan that is re-optimised when due."""

    _carried = ("_day", "_energy_kwh", "_discharged_kwh", "budget", "connection", "_plan")
    _classes: ClassVar = {"_plan": MarketPlan}

    planner: LinearPlanner | AwarePlanner
    system: System
    budget: CycleBudget | None
    connection: GridConnection | None
    _plan: MarketPlan | None = None
    _day: int | None = None
    _energy_kwh: float = 0.0
    _discharged_kwh: float = 0.0

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        state = now.state
        self.measured(step, state.soc, state.soh_capacity)
        if self.budget is not None:
            self.budget.advance(step, state, now.delivered_kw, limit_kw=now.limit_kw)
        if self.connection is not None:
            self.connection.advance(step, now.delivered_kw)
        if self._plan is None or self.planner.is_due(step, now, self._plan):
            limits = {} if self.budget is None else self.budget.for_plan()
            self._plan = self.planner.plan(step, now, self._discharged_kwh, **limits)
        offset = step - self._plan.step
        demand_kw = padded(self._plan.demand_kw[offset : offset + horizon], horizon)
        if self.connection is not None:
            dt_h = self.system.control.dt_h
            stored_kwh = nominal_stored_kwh(self.system, state.soc, state.soh_capacity)
            max_kw = min(float(stored_kwh[counted(now.limit_kw)].sum()) / dt_h, float(now.limit_kw.sum()))
            demand_kw[0] = self.connection.limited(step, float(demand_kw[0]), max_kw)
        return demand_kw if self.budget is None else self.budget.limited(demand_kw)

    def block(self, step: int, most: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        now_kw, plan = self.ahead(step, horizon, now), self._plan
        assert plan is not None
        if self.budget is not None or self.connection is not None:
            return now_kw[None]
        last = min(step + most, plan.step + plan.demand_kw.size)
        due = (each for each in range(step + 1, last) if self.planner.is_due(each, None, plan))
        left_kw = plan.demand_kw[step - plan.step :]
        ahead_kw = sliding_window_view(padded(left_kw, left_kw.size + horizon), horizon)
        return ahead_kw[: next(due, last) - step].copy()

    def measured(self, step: int, soc: Array, soh_capacity: Array) -> None:
        """Add the energy discharged in the previous step; a step that ends at midnight counts for its day."""
        energy_kwh = float(nominal_stored_kwh(self.system, soc, soh_capacity).sum())
        day = int(self.planner.days[step])
        if day == self._day:
            self._discharged_kwh += max(0.0, self._energy_kwh - energy_kwh)
        else:
            self._discharged_kwh = 0.0
        self._day, self._energy_kwh = day, energy_kwh

    def planned(self, step: int) -> dict[str, float]:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        assert self._plan is not None
        row = {"expected_kw": float(self._plan.expected_delivered_kw[step - self._plan.step])}
        return row if self.budget is None else row | self.budget.recorded()
