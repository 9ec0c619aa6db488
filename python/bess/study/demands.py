"""Section ``[demand]`` of a study file: kinds of demand and their detection."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Tag, model_validator

from bess.files import Fill
from bess.study.sections import RunName
from bess.study.services import (
    SERVICES,
    FcrArbitrageDemand,
    FcrDemand,
    PeakShavingDemand,
    SelfConsumptionDemand,
    TradeMeterSection,
)
from bess.system.quantities import NonNegative, Positive, within
from bess.system.section import Section


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
    """Section ``[demand]`` with ``kind = "arbitrage"``: buy and sell at the prices of a market file.

    The file is read as :func:`bess.read_prices` says. ``plan`` is ``aware``
    (:class:`bess.dispatch.DynamicProgramDispatch`, which asks the plant) or ``linear``
    (:class:`bess.dispatch.Arbitrage`, which takes a constant ``efficiency``). ``max_power_kw`` and
    ``max_energy_kwh`` keep below what the plant has, ``max_import_kw`` and ``max_export_kw`` within the grid
    connection in each direction; ``market_time_zone`` is that of the trading day, to
    which ``cycles_per_day`` applies; with ``cycles_per_plan`` there is a limit for each plan instead, on the
    mean of what is charged and discharged (AC). ``end_price_eur_mwh`` is what a MWh left in store at the end
    of an aware plan is worth; by default the median price of buying, or what the best tenth of prices brings
    if that is less. A plan is made anew every ``replan_h``; an aware one, if that is omitted, when inverters
    in service, prices ahead, stored energy or temperature are not as it counted on (compared every 3 h,
    inverters in every step), and when a sixth of its time, or 6 h, has passed; a linear one every 3 h.
    ``repeat`` lets the last year of the file follow year by year, for runs over decades
    (:func:`bess.market.prolonged`). ``forecast`` is that of prices; with ``file`` it is read from
    ``forecast_prices``, a price file of its own. With ``bands`` an aware plan weighs several levels of each
    price (:class:`bess.dispatch.BandForecast`), from columns ``p10``, ``p50`` and ``p90`` of
    ``forecast_prices`` or from measured errors of persistence; with ``expected``, and in a linear plan, it
    takes their mean as certain. What is sold is settled at the prices that came true.
    ``meter`` has load and generation behind the same meter, for linear plans
    (:class:`bess.dispatch.GridConnection`). Before the market of ``prices``, each ``market`` is an auction in
    which the day is sold first (:func:`bess.dispatch.auction_positions`).
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
