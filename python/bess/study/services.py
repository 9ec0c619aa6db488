"""Sections ``[demand]`` of services: frequency containment, peak shaving, self-consumption."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from bess.files import Fill
from bess.parameters.quantities import Fraction, NonNegative, Positive, within
from bess.parameters.section import Section

Efficiency = Annotated[float, within(0.0, 1.0, above=True)]

SYNTHETIC = "synthetic"
"""Name of the bundled weeks of grid frequency and of prices."""


class FcrDemand(Section):
    """Section ``[demand]`` with ``kind = "fcr"``: frequency containment reserve.

    ``frequency`` is ``synthetic``, a bundled week, or a file as :func:`bess.market.read_frequency` takes it;
    with ``repeat`` it begins at the start of the run and starts again at its end. The plant answers with
    ``capacity_kw`` at a deviation of ``droop_mhz``, in proportion below, and not at all within
    ``dead_band_mhz``; a control step asks for the mean of that. By default the capacity leaves a fifth of
    the plant's power for recharging.

    So much must be in store that the whole capacity can be delivered for ``duration_min`` in either
    direction. Outside the middle ``band`` of that window the set-point is shifted by up to ``recharge_kw`` (a
    quarter of the capacity by default), in slots of ``recharge_slot_min`` that are agreed on
    ``recharge_lead_min`` ahead, each with the ``efficiency`` of the round trip in mind.

    The capacity is paid by ``capacity_prices``, a file as :func:`bess.market.read_capacity_prices` takes it
    (the column of ``country``), or ``capacity_price_eur_mw`` for each block of four hours. What is charged
    and discharged beside the response is settled at ``prices`` (a price file, or ``synthetic``, a bundled
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
    """Section ``[demand]`` with ``kind = "fcr-arbitrage"``: trade with what the reserve leaves.

    As of ``kind = "fcr"``, whose keys it has: the capacity (by default half of the plant's power) and the
    energy for it are reserved at all times. The rest of the power, less ``recharge_kw``, trades within the
    middle ``band`` of the required window, by linear plans as of ``kind = "arbitrage"`` with ``plan =
    "linear"``, over ``look_ahead_h`` and made anew every ``replan_h``.
    """

    kind: Literal["fcr-arbitrage"] = "fcr-arbitrage"  # type: ignore[assignment]
    band: Fraction = 0.9
    prices: str | None = SYNTHETIC
    market_time_zone: str = "Europe/Berlin"
    cycles_per_day: Positive = 1.0
    look_ahead_h: Positive = 36.0
    replan_h: Positive = 1.0


class SiteDemand(Section):
    """A load, and generation perhaps, behind one meter with the plant.

    ``load`` and ``pv`` are bundled (``industrial-week``, ``commercial-week``, ``solar-week``) or files as
    :func:`bess.ems.read_profile` reads them, positive for what the load draws and the panels give; ``repeat``
    starts both again at their end. ``price_eur_mwh`` is paid for what the meter draws,
    ``export_price_eur_mwh`` for what it gives. What the plant will be asked ahead follows from the forecast
    of load and generation, and from the round trip: ``efficiency`` at first, then what the plant shows.
    """

    kind: Literal["peak-shaving", "self-consumption"]
    load: str
    column: str | None = None
    scale: Positive = 1.0
    pv: str | None = None
    pv_column: str | None = None
    pv_scale: Positive = 1.0
    unit: Literal["kW", "W", "MW"] = "kW"
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    efficiency: Efficiency = 0.9
    ready_soc: Fraction = 1.0
    price_eur_mwh: float = 250.0
    export_price_eur_mwh: float = 80.0
    forecast: Literal["perfect", "persistence"] = "perfect"


class PeakShavingDemand(SiteDemand):
    """Section ``[demand]`` with ``kind = "peak-shaving"``: a limit on what the grid connection draws.

    The store gives what the load takes above ``limit_kw`` and fills up to ``ready_soc`` with what is left
    below it. Without ``limit_kw`` it is the lowest that a schedule with perfect foresight could keep
    (:func:`bess.ems.least_peak_kw`). A kW less of the highest draw in the run saves
    ``demand_charge_eur_kw_year``, by the share of the run in a year.
    """

    kind: Literal["peak-shaving"] = "peak-shaving"
    load: str = "industrial-week"
    limit_kw: Positive | None = None
    demand_charge_eur_kw_year: NonNegative = 100.0


class SelfConsumptionDemand(SiteDemand):
    """Section ``[demand]`` with ``kind = "self-consumption"``: keep what the panels give for the load.

    The store charges what the panels give beyond the load, up to ``ready_soc``, and gives it back when they
    do not suffice.
    """

    kind: Literal["self-consumption"] = "self-consumption"
    load: str = "commercial-week"
    pv: str | None = "solar-week"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pv is None:
            raise ValueError("self-consumption needs generation: pv names the panels' profile")
        return self


Service = FcrDemand | FcrArbitrageDemand | PeakShavingDemand | SelfConsumptionDemand
SERVICES = ("fcr", "fcr-arbitrage", "peak-shaving", "self-consumption")
"""Kinds of demand that are services."""
