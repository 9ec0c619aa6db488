"""The few figures that a page of one run leads with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bess.analysis.catalogue import Kpis, kpi
from bess.analysis.settlement import REVENUES


@dataclass(frozen=True)
class Tile:
    """One large figure with its name, and below it what it is made of."""

    label: str
    figure: str
    unit: str
    detail: str


def tiles(kpis: Kpis) -> list[Tile]:
    """Delivered, lost, net income where there are prices, efficiency, temperature."""
    return list(_tiles(kpis))


def _tiles(kpis: Kpis) -> Iterator[Tile]:
    fulfilled = _quantity("fulfilment_pct", kpis)
    yield _tile("delivered_kwh", kpis, f"{fulfilled} of {_whole(kpis['demand_kwh'])} kWh asked for")
    parts = {
        "undelivered_kwh": "not delivered",
        "inverter_loss_kwh": "inverters",
        "battery_loss_kwh": "batteries",
    }
    detail = " + ".join(f"{_whole(kpis[name])} {where}" for name, where in parts.items())
    worth = losses_eur(kpis)
    yield _tile("lost_kwh", kpis, detail if worth is None else f"{detail}; worth {_whole(worth)} EUR")
    if "net_eur" in kpis:
        revenue = sum(kpis.get(name, 0.0) for name in REVENUES)
        detail = f"{_whole(revenue)} revenue − {_whole(revenue - kpis['net_eur'])} costs"
        yield _tile("net_eur", kpis, detail)
    back = "round_trip_efficiency_pct"
    yield _tile("system_efficiency_pct", kpis, f"round trip {_quantity(back, kpis)}" if back in kpis else "")
    hottest = _quantity("peak_node_temperature_c", kpis)
    yield _tile("peak_string_temperature_c", kpis, f"string mean; hottest node {hottest}")
    if kpis.get("soh_capacity_min", 1.0) < 1.0:
        yield _tile("soh_capacity_min", kpis, "of the string that aged most")


def _tile(name: str, kpis: Kpis, detail: str) -> Tile:
    entry = kpi(name)
    number = _whole(kpis[name]) if entry.unit in ("kWh", "EUR") else entry.number(kpis[name])
    return Tile(entry.label, number, entry.unit, detail)


def _quantity(name: str, kpis: Kpis) -> str:
    return kpi(name).quantity(kpis[name])


def losses_eur(kpis: Kpis) -> float | None:
    """Shortfall, and inverter and battery losses at the mean price of charging; None without prices."""
    charged_mwh = kpis.get("charged_kwh", 0.0) / 1000.0
    if "shortfall_eur" not in kpis or charged_mwh <= 0.0:
        return None
    mean_eur_mwh = kpis["charge_cost_eur"] / charged_mwh
    conversion_mwh = (kpis["inverter_loss_kwh"] + kpis["battery_loss_kwh"]) / 1000.0
    return kpis["shortfall_eur"] + max(mean_eur_mwh, 0.0) * conversion_mwh


def _whole(value: float) -> str:
    return f"{value + 0.0:,.0f}"
