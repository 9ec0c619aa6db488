"""Every key figure with its name for people, unit, better direction, digits and meaning.

The terminal, the page, the figures, sweeps and the manual read it; a figure that :func:`bess.kpis` gives and
that is not listed here fails a test. The order is that of every table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from bess.analysis.pareto import Direction
from bess.errors import InputError

Kpis = Mapping[str, float]
"""Key figures of a run, by name, as :func:`bess.kpis` gives them."""
KpisByRun = Mapping[str, Kpis]
"""Those of one or several runs, by the name of the run; one may have the empty name."""

Group = Literal["energy", "money", "efficiency", "temperature", "service", "wear", "strings", "optimiser"]

HEADINGS: Final[dict[Group, str]] = {
    "energy": "Energy",
    "money": "Money",
    "efficiency": "Efficiencies",
    "temperature": "Temperatures",
    "service": "Services",
    "wear": "Wear",
    "strings": "Strings",
    "optimiser": "Optimiser and balance",
}
"""Heading of each group, in the order of every table."""


@dataclass(frozen=True)
class Kpi:
    """How one key figure is shown.

    Attributes
    ----------
    label : str
        Name for people.
    unit : str
        Of the figure as shown; empty for counts and plain ratios.
    better : {"min", "max"} or None
        Which direction is better; None for what carries no judgement.
    decimals : int or None
        Digits after the point; None for magnitudes, shown as ``1.2e-09``.
    meaning : str
        One sentence.
    group : str
        Under which heading it stands.
    detail : bool
        Whether it is left to the tables that show everything.
    factor : float
        What the figure is multiplied with to be shown: 100 for a ratio shown in per cent.
    """

    label: str
    unit: str
    better: Direction | None
    decimals: int | None
    meaning: str
    group: Group
    detail: bool = False
    factor: float = 1.0

    @property
    def heading(self) -> str:
        """Label with unit, for axes and table headers."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def number(self, value: float) -> str:
        """Return the figure as shown, without its unit; a dash if there is none."""
        if math.isnan(value):
            return "–"
        if self.decimals is None:
            return f"{self.factor * value:.1e}"
        # Adding zero turns a rounded -0.0 into 0.0.
        return f"{round(self.factor * value, self.decimals) + 0.0:,.{self.decimals}f}"

    def quantity(self, value: float) -> str:
        """Return the figure with its unit."""
        return f"{self.number(value)} {self.unit}".rstrip()


def _energy(label: str, meaning: str, better: Direction | None = "min", *, detail: bool = False) -> Kpi:
    return Kpi(label, "kWh", better, 1, meaning, "energy", detail)


def _money(label: str, meaning: str, better: Direction | None = "min") -> Kpi:
    return Kpi(label, "EUR", better, 2, meaning, "money")


def _efficiency(label: str, meaning: str) -> Kpi:
    return Kpi(label, "%", "max", 2, meaning, "efficiency")


def _between_strings(label: str, unit: str, decimals: int, what: str) -> Iterable[tuple[str, Kpi]]:
    for moment, when, detail in (
        ("start", "at the start", True),
        ("end", "at the end", False),
        ("mean", "mean over the run", True),
        ("max", "largest of the run", False),
    ):
        better: Direction | None = None if moment == "start" else "min"
        meaning = f"Largest minus smallest {what} of the strings, {when}."
        yield moment, Kpi(f"{label}, {when}", unit, better, decimals, meaning, "strings", detail)


def _over_steps(
    name: str, label: str, unit: str, decimals: int, what: str, factor: float = 1.0
) -> dict[str, Kpi]:
    parts = (("median", "median"), ("p95", "95th percentile"), ("max", "largest"))
    return {
        f"{name}_{part}": Kpi(
            f"{label}, {text}", unit, "min", decimals, f"{what}, {text} over the steps with a solve.",
            "optimiser", part == "p95", factor,
        )
        for part, text in parts
    }  # fmt: skip


CATALOGUE: Final[dict[str, Kpi]] = {
    "demand_kwh": _energy("Asked for", "Energy asked of the plant, charge and discharge added.", None),
    "delivered_kwh": _energy(
        "Delivered", "Energy delivered at the AC side, charge and discharge added.", "max"
    ),
    "fulfilment_pct": Kpi("Fulfilled", "%", "max", 2, "Energy delivered, per energy asked for.", "energy"),
    "undelivered_kwh": _energy(
        "Undelivered",
        "Energy the strings were asked for and did not deliver: shed by full or empty strings, or curtailed "
        "by derating.",
    ),
    "availability_loss_kwh": _energy(
        "Shed by full or empty strings",
        "Energy not delivered because a string was full, empty or at its voltage or current limit.",
    ),
    "derating_loss_kwh": _energy(
        "Curtailed by derating", "Energy not delivered because a string was hot and its power reduced."
    ),
    "unmet_kwh": _energy(
        "Above the power in service",
        "Demand above the nominal power of the inverters in service, which no string was asked for.",
    ),
    "reactive_demand_kvarh": Kpi(
        "Reactive power asked", "kvarh", None, 1, "Reactive power asked of the plant, over time.", "energy",
    ),
    "reactive_kvarh": Kpi(
        "Reactive power carried", "kvarh", "max", 1,
        "Reactive power that the inverters carried; active power comes first.", "energy",
    ),
    "inverter_loss_kwh": _energy("Inverter loss", "Energy lost in the inverters, standby included."),
    "battery_loss_kwh": _energy("Battery loss", "Heat in the internal resistance of the batteries."),
    "hysteresis_loss_kwh": _energy(
        "Hysteresis loss",
        "Energy lost because the open-circuit voltage is lower in discharge than in charge; not part of the "
        "losses above.",
    ),
    "auxiliary_kwh": _energy(
        "Auxiliary energy", "Energy that cooling takes from the grid: fans or pumps, and the source of cold."
    ),
    "lost_kwh": _energy("Lost in total", "Undelivered energy, inverter loss and battery loss added."),
    "request_kwh": _energy(
        "Requested of the strings", "Set-points of all strings, both directions added.", None, detail=True
    ),
    "charged_kwh": _energy("Charged", "Energy taken at the AC side.", None, detail=True),
    "discharged_kwh": _energy("Discharged", "Energy given at the AC side.", None, detail=True),
    "imbalance_kwh": _energy(
        "Planned minus delivered",
        "Difference between what the dispatch expected to be delivered and what was, magnitudes added.",
    ),
    "short_of_charge_kwh": _energy(
        "Short of charge", "Energy the dispatch expected to charge and the plant did not.", detail=True
    ),
    "short_of_discharge_kwh": _energy(
        "Short of discharge", "Energy the dispatch expected to discharge and the plant did not.", detail=True
    ),
    "net_eur": _money(
        "Net",
        "Discharge revenue and pay for capacity less charge cost, shortfall, penalty, wear, starts and "
        "auxiliaries.",
        "max",
    ),
    "discharge_revenue_eur": _money(
        "Discharge revenue", "Discharged energy times price less fee.", "max"
    ),
    "capacity_revenue_eur": _money(
        "For capacity", "What the reserve is paid, or what a lower peak of the grid connection saves.", "max"
    ),
    "charge_cost_eur": _money("Charge cost", "Charged energy times price and fee; negative where that is."),
    "shortfall_eur": _money(
        "Shortfall", "Energy asked for and not delivered, at the magnitude of its price and a penalty."
    ),
    "penalty_eur": _money(
        "Penalty", "Reserve that was sold and not there, at its price times the penalty of the settlement."
    ),
    "wear_eur": _money("Wear", "Ageing of the batteries, by the wear model of the study."),
    "start_eur": _money("Inverter starts", "Starts of inverters, at the price of one."),
    "auxiliary_eur": _money(
        "Auxiliaries",
        "Energy the plant takes beside what it delivers (cooling, standby), at the price of charging.",
    ),
    "npv_eur": _money(
        "Net present value",
        "Net of each year of operation, discounted to the start; of runs that are longer than a year.", "max",
    ),
    "revenue_eur": Kpi(
        "Revenue", "EUR", "max", 2, "Delivered energy times price, charged energy counted negative.", "money"
    ),
    "system_efficiency_pct": _efficiency(
        "System efficiency", "One minus inverter and battery loss per requested energy."
    ),
    "system_efficiency_with_auxiliaries_pct": _efficiency(
        "System efficiency with auxiliaries",
        "One minus inverter loss, battery loss and auxiliaries per requested energy.",
    ),
    "round_trip_efficiency_pct": _efficiency(
        "Round-trip efficiency",
        "Energy given to the grid over energy taken from it, standby and auxiliaries included, as if the "
        "cells ended with the energy they began with.",
    ),
    "availability_pct": _efficiency(
        "Availability", "One minus the energy shed by full or empty strings per energy asked for."
    ),
    "derating_efficiency_pct": _efficiency(
        "Derating efficiency", "One minus the energy curtailed by derating per requested energy."
    ),
    "inverter_efficiency_pct": _efficiency(
        "Inverter efficiency", "One minus inverter loss per requested energy."
    ),
    "battery_efficiency_pct": _efficiency(
        "Battery efficiency", "One minus battery loss per requested energy."
    ),
    "peak_mean_temperature_c": Kpi(
        "Peak mean temperature", "°C", "min", 1,
        "Largest mean over the strings of their mean temperatures.", "temperature",
    ),
    "peak_string_temperature_c": Kpi(
        "Peak string temperature", "°C", "min", 1, "Largest mean temperature of a string.", "temperature"
    ),
    "peak_node_temperature_c": Kpi(
        "Hottest node", "°C", "min", 1, "Largest temperature of any node along the air path.", "temperature"
    ),
    **{
        f"temperature_spread_{moment}_k": kpi
        for moment, kpi in _between_strings("Temperature spread", "K", 1, "mean temperature")
    },
    **{f"soc_spread_{moment}": kpi for moment, kpi in _between_strings("SOC spread", "", 3, "SOC")},
    "outside_window_h": Kpi(
        "Reserve not sustained", "h", "min", 2,
        "Time in which the store could not have given the whole reserve for its duration.", "service",
    ),
    "response_kwh": Kpi(
        "Response to frequency", "kWh", None, 1,
        "Energy that the frequency called for, both directions added.", "service",
    ),
    "peak_before_kw": Kpi(
        "Peak without the plant", "kW", None, 1, "Highest draw of the grid connection without the plant.",
        "service",
    ),
    "peak_draw_kw": Kpi("Peak", "kW", "min", 1, "Highest draw of the grid connection.", "service"),
    "above_limit_kwh": Kpi(
        "Drawn above the limit", "kWh", "min", 2, "Energy drawn above the limit of the grid connection.",
        "service",
    ),
    "import_kwh": Kpi("Drawn from the grid", "kWh", "min", 1, "Energy that the meter drew.", "service"),
    "export_kwh": Kpi("Given to the grid", "kWh", None, 1, "Energy that the meter gave.", "service"),
    "self_consumption_pct": Kpi(
        "Self-consumption", "%", "max", 2, "Generation that the meter did not give to the grid.", "service"
    ),
    "self_sufficiency_pct": Kpi(
        "Self-sufficiency", "%", "max", 2, "Load that the meter did not draw from the grid.", "service"
    ),
    "soh_capacity_min": Kpi(
        "Capacity left, oldest string", "", "max", 4,
        "Capacity at the end over that of the system file, of the string with least.", "wear",
    ),
    "soh_capacity_mean": Kpi(
        "Capacity left", "", "max", 4,
        "Capacity at the end over that of the system file, mean over the strings.", "wear",
    ),
    "soh_resistance_max": Kpi(
        "Resistance, oldest string", "", "min", 4,
        "Resistance at the end over that of the system file, of the string with most.", "wear",
    ),
    "end_of_life_days": Kpi(
        "First end of life", "d", "max", 1,
        "Days until the capacity of the first string fell to its end of life.", "wear",
    ),
    "full_cycles": Kpi(
        "Full cycles", "", None, 2, "Half of the SOC travelled, mean over the strings.", "strings"
    ),
    "inverter_starts_mean": Kpi(
        "Starts of an inverter", "", "min", 1, "Off-to-on transitions, mean over the inverters.", "strings"
    ),
    "inverter_starts_max": Kpi(
        "Starts of the busiest inverter", "", "min", 0, "Off-to-on transitions of the inverter with most.",
        "strings", True,
    ),
    "starts_per_day": Kpi(
        "Starts a day", "", "min", 1, "Off-to-on transitions of all inverters, for each day.", "strings"
    ),
    "ledger_residual_ratio": Kpi(
        "Ledger residual per energy", "", None, None,
        "Energy the plant's balance misses, per delivered energy: rounding, if all is well.", "optimiser",
    ),
    "fallback_steps": Kpi(
        "Fallback steps", "", "min", 0, "Steps in which a fallback replaced the optimiser's answer.",
        "optimiser",
    ),
    "solver_steps": Kpi("Steps with a solve", "", None, 0, "Steps the optimiser was called in.", "optimiser"),
    "plan_search_gap_pct": Kpi(
        "Search gap of plans", "%", None, 2,
        "Median distance of the plans with bounds to a lower bound by prices, an estimate.", "optimiser",
    ),
    "plan_gap_pct": Kpi(
        "Proven gap of plans", "%", None, 2,
        "Median distance of the plans with bounds to a proven lower bound on the control model.", "optimiser",
    ),
    **_over_steps(
        "solver_gap", "Rigorous gap", "%", 3,
        "Distance of the split to a bound no split can pass on the control model", 100.0,
    ),
    **_over_steps(
        "solver_search_gap", "Search gap", "%", 3,
        "Distance of the split to the bound of the convexified program, on which the search stops", 100.0,
    ),
    **_over_steps("solver_nodes", "Nodes", "", 0, "Conic programs solved in a step"),
    **_over_steps("solve_time_s", "Solve time", "ms", 1, "Wall-clock time of a step's solve", 1000.0),
}  # fmt: skip
"""All key figures, by the name that :func:`bess.kpis` gives them."""


def kpi(name: str) -> Kpi:
    """Return the entry of a key figure; of one that is not listed (a plug-in's), its bare name."""
    return CATALOGUE.get(name) or Kpi(name, "", None, 3, "", "strings", detail=True)


def better(name: str) -> Direction:
    """Return which direction of a key figure is better.

    Raises
    ------
    InputError
        If it carries no judgement.
    """
    direction = kpi(name).better
    if direction is None:
        raise InputError(f"{name}: more of it is neither better nor worse; choose another key figure")
    return direction


def in_order(names: Iterable[str]) -> list[str]:
    """Return names in the order of the catalogue; those not listed come last."""
    places = {name: place for place, name in enumerate(CATALOGUE)}
    return sorted(dict.fromkeys(names), key=lambda name: places.get(name, len(places)))
