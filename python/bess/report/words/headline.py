"""Headline of the page of a run: its main figures, and what limits the plant, with remedies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.control.policies.planned import PLANNED
from bess.display import amount
from bess.plant.flows import Limit
from bess.report.data import step_h
from bess.report.runs import Run
from bess.simulation.analysis.catalogue import Kpis, kpi
from bess.simulation.analysis.services import is_reserve, is_site
from bess.simulation.analysis.settlement import REVENUES
from bess.units import DAYS_PER_YEAR, HOURS_PER_DAY

_HOURS_PER_YEAR = HOURS_PER_DAY * DAYS_PER_YEAR
_KW_PER_MW = 1000.0
_MIN_UNMET_KWH = 0.5
_BUDGETS = {"cycles_per_year": "full cycles", "throughput_mwh_per_year": "MWh discharged"}


@dataclass(frozen=True)
class Tile:
    """One large figure with its name, and its parts below."""

    label: str
    figure: str
    unit: str
    detail: str


def tiles(run: Run) -> list[Tile]:
    """Tiles of a service or of years first, if any; then loss, gain, net income, efficiency, heat."""
    return [*_service(run), *_years(run), *_every(run)]


def _service(run: Run) -> Iterator[Tile]:
    kpis, data = run.kpis, run.dataset
    if is_reserve(data):
        sold_kw = float(data["capacity_kw"].values.mean())
        hours = data.sizes["time"] * step_h(data)
        yield Tile("Reserve sold", amount(sold_kw), "kW", f"on average of {hours:,.4g} h")
        yield _tile("outside_window_h", kpis, "in which the strings could not sustain the full reserve")
        if sold_kw > 0.0 and "net_eur" in kpis:
            per_mw = kpis["net_eur"] / (sold_kw / _KW_PER_MW)
            yield Tile("Net per MW of reserve", amount(per_mw), "EUR/MW", f"{per_mw / hours:.2f} EUR/MW/h")
    if is_site(data):
        yield _tile("peak_draw_kw", kpis, f"without the plant {_quantity('peak_before_kw', kpis)}")
        if "self_consumption_pct" in kpis:
            yield _tile("self_consumption_pct", kpis,
                        f"self-sufficiency {_quantity('self_sufficiency_pct', kpis)}")  # fmt: skip


def _years(run: Run) -> Iterator[Tile]:
    kpis = run.kpis
    years = run.dataset.sizes["time"] * step_h(run.dataset) / _HOURS_PER_YEAR
    if "npv_eur" in kpis:
        yield _tile("npv_eur", kpis, f"of {years:.1f} years of operation")
    left = kpis.get("soh_capacity_min", 1.0)
    if left < 1.0:
        end = min(string.wear.end_of_life for string in run.system.strings)
        if "end_of_life_days" in kpis:
            life = kpis["end_of_life_days"] / DAYS_PER_YEAR
            yield Tile(
                "End of life", f"{life:.1f}", "years", f"first string at {100.0 * end:.0f} % of capacity"
            )
        elif years >= 1.0 and end < 1.0:
            life = years * (1.0 - end) / (1.0 - left)
            detail = f"to {100.0 * end:.0f} % of capacity, at the mean pace of {years:.1f} years"
            yield Tile("To end of life", f"{life:.1f}", "years", detail)
        yield Tile("Capacity left", f"{100.0 * left:.1f}", "%", "of the string with the lowest capacity")
    if "cash_npv_eur" in kpis and "investment_eur" in kpis:
        detail = f"{amount(kpis['investment_eur'])} EUR of new batteries paid, residual value added"
        yield _tile("cash_npv_eur", kpis, detail)
    for name in ("round_trip_efficiency_margin", "availability_margin", "throughput_left_mwh"):
        if f"contract_{name}" in kpis:
            yield _tile(f"contract_{name}", kpis, "by the section [contract]")
    if "budget_used_pct" in kpis:
        limits = run.study["budget"]
        allowed = [
            f"{limits[name]:,g} {unit}" for name, unit in _BUDGETS.items() if limits.get(name) is not None
        ]
        yield _tile("budget_used_pct", kpis, f"of {' and '.join(allowed)} a year, in the year of most use")


def _every(run: Run) -> Iterator[Tile]:
    kpis = run.kpis
    parts = {
        "undelivered_kwh": "undelivered",
        "inverter_loss_kwh": "inverters",
        "battery_loss_kwh": "cells",
    }
    detail = " + ".join(f"{amount(kpis[name])} {where}" for name, where in parts.items())
    if kpis["unmet_kwh"] >= _MIN_UNMET_KWH:
        detail += f"; besides, {amount(kpis['unmet_kwh'])} unmet"
    yield _tile("lost_kwh", kpis, detail)
    if "gain_kwh" in kpis and run.gain_rule != run.policy:
        yield _tile("gain_kwh", kpis, f"{run.gain_rule}: {amount(kpis['lost_kwh'] + kpis['gain_kwh'])} kWh")
    if "net_eur" in kpis:
        revenue = sum(kpis.get(name, 0.0) for name in REVENUES)
        costs = revenue - kpis["net_eur"]
        detail = f"{amount(revenue)} revenue{' −' if costs >= 0.0 else ','} {amount(costs)} costs"
        yield _tile("net_eur", kpis, detail)
    if "round_trip_efficiency_pct" in kpis:
        yield _tile("round_trip_efficiency_pct", kpis, "grid to grid, standby and cooling included")
    derating = min(string.derating.start_c for string in run.system.strings)
    yield _tile(
        "peak_string_temperature_c", kpis, f"mean of the hottest string; derating from {derating:g} °C"
    )
    if "plan_gap_pct" in kpis:
        search = _quantity("plan_search_gap_pct", kpis)
        yield _tile("plan_gap_pct", kpis, f"to the rigorous lower bound; estimated {search}")


def _tile(name: str, kpis: Kpis, detail: str) -> Tile:
    entry = kpi(name)
    number = amount(kpis[name]) if entry.unit in ("kWh", "EUR") else entry.number(kpis[name])
    return Tile(entry.label, number, entry.unit, detail)


def _quantity(name: str, kpis: Kpis) -> str:
    return kpi(name).quantity(kpis[name])


_MIN_NAMED_SHARE = 0.15
"""Share of the loss from which a cause is named."""
_MANY_STARTS_PER_DAY = 12.0
_PART_LOAD = 0.5
"""Mean load below which fewer inverters would have lower losses."""


def limit_sentences(run: Run) -> list[str]:
    """Name the two largest parts of the loss, each with a remedy; and frequent starts."""
    causes = sorted(_causes(run), key=lambda cause: -cause[0])
    total = sum(kwh for kwh, _, _ in causes)
    unmet = run.kpis["unmet_kwh"] >= _MIN_UNMET_KWH
    whole = "what is unmet, undelivered or lost" if unmet else "the losses"
    said = [
        f"{text}: {kpi('lost_kwh').quantity(kwh)}, {100.0 * kwh / total:.0f} % of {whole}. {remedy}"
        for kwh, text, remedy in causes[:2]
        if kwh > _MIN_NAMED_SHARE * total
    ]
    starts = run.kpis["starts_per_day"] / run.dataset.sizes["string"]
    # Less than a day has the starts of its own beginning.
    if min(starts, run.kpis["inverter_starts_mean"]) > _MANY_STARTS_PER_DAY:
        # Only plans weigh starts against losses.
        planned = (run.dataset["solver_status"].values == PLANNED).any()
        remedy = " Fewer starts: raise policy.objectives.start_kwh, the price of a start." * bool(planned)
        said.append(f"{starts:.0f} starts of each inverter a day.{remedy}")
    return said


def _causes(run: Run) -> Iterator[tuple[float, str, str]]:
    """Energy [kWh], cause and remedy of each part of the loss."""
    data, kpis = run.dataset, run.kpis
    hours = step_h(data)
    discharge = data["demand_kw"].values > 0.0
    hot_kw, shed_kw = (data[name].values for name in ("derating_loss_kw", "availability_loss_kw"))
    above_h = np.count_nonzero(data["unmet_kw"].values > 0.0) * hours
    above = f"Demand above the power in service in {above_h:,.4g} h"
    yield kpis["unmet_kwh"], above, "More inverter power would help."
    losses = (
        ("Derating of hot strings", hot_kw, "More cooling, or lower power,"),
        ("Empty strings", shed_kw * discharge[:, None], "More energy capacity, or earlier charging,"),
        ("Full strings", shed_kw * ~discharge[:, None], "More energy capacity, or earlier discharging,"),
    )
    for text, lost_kw, remedy in losses:
        lost_h = np.count_nonzero(lost_kw.sum(axis=1) > 0.0) * hours
        split = another_split(run, lost_kw.sum(axis=1), discharge)
        yield float(lost_kw.sum()) * hours, f"{text} in {lost_h:,.4g} h", f"{remedy} would help.{split}"
    delivered_kw, nominal_kw = np.abs(data["delivered_kw"].values), run.system.nominal_kw
    load = delivered_kw.sum() / max(float(((delivered_kw > 0.0) * nominal_kw).sum()), 1e-9)
    inverters = f"Inverters, at {100.0 * load:.0f} % of nominal power while they run"
    several = np.count_nonzero(delivered_kw, axis=1).max() > 1
    fewer = "Fewer inverters at a time" if several else "A smaller inverter"
    better = fewer if load < _PART_LOAD else "Better inverters"
    yield kpis["inverter_loss_kwh"], inverters, f"{better} would help."
    cells_kwh = kpis["battery_loss_kwh"] + kpis.get("hysteresis_loss_kwh", 0.0)
    yield cells_kwh, "Resistance and hysteresis of the cells", "Lower currents would help."
    yield kpis["auxiliary_kwh"], "Cooling", "A higher start temperature would help."


def another_split(run: Run, lost_kw: Array, discharge: NDArray[np.bool_]) -> str:
    """Share of a loss for which other strings had power and energy left in the same step; "" if small."""
    data, system = run.dataset, run.system
    # Strings that are out of service, or not there yet, have no power.
    if lost_kw.sum() <= 0.0 or run.study.get("event") or "investment_eur" in data:
        return ""
    soc = data["soc"].values
    low, high = system.soc_window
    room = np.where(discharge[:, None], soc - low, high - soc)
    spare_kw = np.minimum(
        system.nominal_kw - np.abs(data["delivered_kw"].values),
        room * system.nominal_energy_kwh * data["soh_capacity"].values / step_h(data),
    )
    bound = data["limits"].values.astype(int) & sum(Limit) > 0
    free_kw = np.where(bound, 0.0, np.maximum(spare_kw, 0.0)).sum(axis=1)
    share = np.minimum(free_kw, lost_kw).sum() / lost_kw.sum()
    if share < _MIN_NAMED_SHARE:
        return ""
    return (
        f" For {100.0 * share:.0f} % of it other strings had power and energy left: another split may help."
    )
