"""Section ``[demand]`` of a study file: kinds of demand, their detection, and grid services."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Tag, model_validator

from bess.files import Fill
from bess.study.sections import RunName
from bess.system.quantities import Fraction, NonNegative, Positive, within
from bess.system.section import Section

Efficiency = Annotated[float, within(0.0, 1.0, above=True)]

SYNTHETIC = "synthetic"
"""Name of the bundled weeks of grid frequency and of prices."""


class FcrDemand(Section):
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
    energy_price_eur_mwh: float = 80.0
    forecast: Literal["expected", "persistence"] = "expected"


class FcrArbitrageDemand(FcrDemand):
    """Section ``[demand]`` with ``kind = "fcr-arbitrage"``: trade with the power beside the reserve.

    The capacity (by default half of the plant power) and its energy are reserved at all times, with the keys
    of ``kind = "fcr"``. The remaining power, minus ``recharge_kw``, trades within the central ``band`` of the
    required window. Linear dispatch, as with ``plan = "linear"``, covers ``look_ahead_h`` and is re-optimised
    every ``replan_h``. With ``choose_capacity`` the reserve of each four-hour block is chosen the day before,
    up to ``capacity_kw``, together with the trade (:func:`bess.dispatch.reserve_blocks`), at known prices or
    those of the day before.
    """

    kind: Literal["fcr-arbitrage"] = "fcr-arbitrage"  # type: ignore[assignment]
    band: Fraction = 0.9
    choose_capacity: Literal["perfect", "persistence"] | None = None
    prices: str | None = SYNTHETIC
    market_time_zone: str = "Europe/Berlin"
    cycles_per_day: Positive = 1.0
    look_ahead_h: Positive = 36.0
    replan_h: Positive = 1.0


class MeterSection(Section):
    """Load and generation behind one meter with the plant, and the tariff of its peak.

    ``load`` and ``pv`` are bundled (``industrial-week``, ``commercial-week``, ``solar-week``) or files as
    :func:`bess.dispatch.read_profile` reads them, positive for consumption and generation;
    ``repeat`` repeats both. ``peak_eur_kw_month`` is the price of the highest quarter-hour mean of the grid
    import in each calendar month of ``billing_time_zone``; a month that the run covers in part is charged in
    full.
    """

    load: str | None = None
    column: str | None = None
    scale: Positive = 1.0
    pv: str | None = None
    pv_column: str | None = None
    pv_scale: Positive = 1.0
    unit: Literal["kW", "W", "MW"] = "kW"
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    peak_eur_kw_month: Positive | None = None
    billing_time_zone: str = "Europe/Berlin"
    forecast: Literal["perfect", "persistence"] = "perfect"


class TradeMeterSection(MeterSection):
    """Section ``[demand.meter]`` of ``kind = "arbitrage"``: trade behind a meter with load or generation.

    Import costs the market price plus ``import_fee_eur_mwh``, export earns the market price.
    ``max_import_kw`` and ``max_export_kw`` hold at the meter: generation above the limit of the export is
    curtailed unless the plant charges it.
    """

    import_fee_eur_mwh: NonNegative = 0.0


class SiteDemand(MeterSection):
    """Load and optional generation behind one meter with the plant, at constant prices.

    ``price_eur_mwh`` is the grid import price, ``export_price_eur_mwh`` the export
    price. The forecast of the demand depends on the forecast of load and generation and on the round-trip
    efficiency: initially ``efficiency``, later the measured value.
    """

    kind: Literal["peak-shaving", "self-consumption"]
    load: str
    efficiency: Efficiency = 0.9
    ready_soc: Fraction = 1.0
    price_eur_mwh: float = 250.0
    export_price_eur_mwh: float = 80.0


class PeakShavingDemand(SiteDemand):
    """Section ``[demand]`` with ``kind = "peak-shaving"``: limit on the grid import.

    The plant supplies the load above ``limit_kw`` and charges up to ``ready_soc`` with the remaining power
    below it. By default, ``limit_kw`` is the lowest limit that is feasible with perfect foresight
    (:func:`bess.dispatch.min_peak_kw`). A kW of reduced peak import saves ``demand_charge_eur_kw_year``,
    in proportion to the length of the run; with ``peak_eur_kw_month``, each month has a limit of its own, and
    its price replaces that of the year.
    """

    kind: Literal["peak-shaving"] = "peak-shaving"
    load: str = "industrial-week"
    limit_kw: Positive | None = None
    demand_charge_eur_kw_year: NonNegative = 100.0


class SelfConsumptionDemand(SiteDemand):
    """Section ``[demand]`` with ``kind = "self-consumption"``: store surplus generation for the load.

    The plant charges surplus generation up to ``ready_soc`` and discharges when generation is below the load.
    """

    kind: Literal["self-consumption"] = "self-consumption"
    load: str = "commercial-week"
    pv: str | None = "solar-week"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pv is None:
            raise ValueError("self-consumption requires generation: set pv to a generation profile")
        return self


Service = FcrDemand | FcrArbitrageDemand | PeakShavingDemand | SelfConsumptionDemand
SERVICES = ("fcr", "fcr-arbitrage", "peak-shaving", "self-consumption")
"""Kinds of demand that are services."""


class ProfileDemand(Section):
    """Section ``[demand]`` with ``kind = "profile"``: a given power series.

    ``file`` is a bundled profile or a CSV or Parquet file, read with :func:`bess.dispatch.read_profile`;
    ``repeat`` repeats it.
    """

    kind: Literal["profile"] = "profile"
    file: str
    column: str | None = None
    unit: Literal["kW", "W", "MW"] = "kW"
    positive: Literal["discharge", "charge"] = "discharge"
    scale: Positive = 1.0
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    forecast: Literal["perfect", "persistence"] = "perfect"


class MarketSection(Section):
    """Section ``[[demand.market]]``: an auction of a whole day, which the last market trades again.

    The auctions are in the order of their gates; a product is one control step or longer, and no longer than
    that of the auction before. Files are read as those of ``demand.prices``, by default the same file.
    """

    name: RunName
    prices: str | None = None
    product: str | None = None
    step_min: Annotated[float, within(1.0, 1440.0, "min")] = 60.0


class ArbitrageDemand(Section):
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
    ``"expected"``, and a linear plan, use their mean. Actual prices are settled. ``meter`` is load and
    generation behind the same meter, for linear plans (:class:`bess.dispatch.GridConnection`). Each
    ``market`` is an auction before the market of ``prices`` (:func:`bess.dispatch.auction_positions`).
    """

    kind: Literal["arbitrage"] = "arbitrage"
    prices: str | None = None
    zone: str = "DE-LU"
    product: str | None = None
    time_zone: str | None = None
    fill: Fill | None = None
    market_time_zone: str = "Europe/Berlin"
    max_power_kw: Positive | None = None
    max_energy_kwh: Positive | None = None
    max_import_kw: Positive | None = None
    max_export_kw: Positive | None = None
    plan: Literal["aware", "linear"] = "aware"
    efficiency: Annotated[float, within(0.0, 1.0, above=True)] = 0.9
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
            raise ValueError('meter: only plan = "linear" knows of a meter with load and generation')
        return self


def kind_of_demand(demand: object) -> str | None:
    """Return ``kind``, or the kind implied by the other keys."""
    if not isinstance(demand, Mapping):
        return getattr(demand, "kind", None)
    kind = demand.get("kind", "arbitrage" if "prices" in demand else "profile")
    return kind if kind in DEMAND_KINDS else None


TRADES = ("arbitrage", "fcr-arbitrage")
"""Kinds that buy and sell at prices that change."""

DEMAND_KINDS = ("profile", "arbitrage", *SERVICES)

Demand = Annotated[
    Annotated[ProfileDemand, Tag("profile")]
    | Annotated[ArbitrageDemand, Tag("arbitrage")]
    | Annotated[FcrDemand, Tag("fcr")]
    | Annotated[FcrArbitrageDemand, Tag("fcr-arbitrage")]
    | Annotated[PeakShavingDemand, Tag("peak-shaving")]
    | Annotated[SelfConsumptionDemand, Tag("self-consumption")],
    Discriminator(
        kind_of_demand,
        custom_error_type="kind",
        custom_error_message='must be a table with kind = "profile" (and file), "arbitrage" (and prices), '
        + ", ".join(f'"{kind}"' for kind in SERVICES[:-1])
        + f' or "{SERVICES[-1]}"',
    ),
]
