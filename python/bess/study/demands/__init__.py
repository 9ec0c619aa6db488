"""Section ``[demand]`` of a study file: one module for each kind of demand, and the list of the kinds."""

from collections.abc import Mapping
from typing import Annotated, get_args

from pydantic import Discriminator, Tag

from bess.study.demands.arbitrage import ArbitrageDemand
from bess.study.demands.profile import ProfileDemand
from bess.study.demands.reserve import FcrArbitrageDemand, FcrDemand
from bess.study.demands.site import PeakShavingDemand, SelfConsumptionDemand
from bess.study.demands.source import DemandSection

__all__ = [
    "ArbitrageDemand",
    "FcrArbitrageDemand",
    "FcrDemand",
    "PeakShavingDemand",
    "ProfileDemand",
    "SelfConsumptionDemand",
]

Kinds = (
    Annotated[ProfileDemand, Tag("profile")]
    | Annotated[ArbitrageDemand, Tag("arbitrage")]
    | Annotated[FcrDemand, Tag("fcr")]
    | Annotated[FcrArbitrageDemand, Tag("fcr-arbitrage")]
    | Annotated[PeakShavingDemand, Tag("peak-shaving")]
    | Annotated[SelfConsumptionDemand, Tag("self-consumption")]
)
"""The registry: the section of each kind of demand."""

DEMAND_KINDS: dict[str, type[DemandSection]] = {
    each.__metadata__[0].tag: each.__origin__ for each in get_args(Kinds)
}
"""Sections by the name of their kind."""

TRADES = tuple(kind for kind, section in DEMAND_KINDS.items() if section.trades)
"""Kinds of demand that trade at variable prices."""


def kind_of_demand(demand: object) -> str | None:
    """Return ``kind``, or the kind implied by the other keys; None for what is no section."""
    if not isinstance(demand, Mapping):
        return getattr(demand, "kind", None)
    return str(demand.get("kind", "arbitrage" if "prices" in demand else "profile"))


Demand = Annotated[Kinds, Discriminator(kind_of_demand)]
