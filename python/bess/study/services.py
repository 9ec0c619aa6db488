"""Sections ``[demand]`` of services: frequency containment, peak shaving, self-consumption."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from bess.files import Fill
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
