"""Catalogue of KPIs: label, unit, preferred direction, digits and meaning.

The terminal, the HTML page, figures, sweeps and the manual use it. A test fails if :func:`bess.kpis` returns
a KPI that is not listed here. Every table uses the order of the catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from bess.errors import InputError
from bess.simulation.analysis.pareto import Direction

Kpis = Mapping[str, float]
"""KPIs of a run, by name, as returned by :func:`bess.kpis`."""
KpisByRun = Mapping[str, Kpis]
"""KPIs by the name of the run; the name may be empty."""

Group = Literal[
    "energy", "losses", "money", "service", "efficiency", "temperature", "ageing", "strings", "solver"
]

HEADINGS: Final[dict[Group, str]] = {
    "energy": "Energy",
    "losses": "Losses",
    "money": "Money",
    "service": "Service",
    "efficiency": "Efficiency",
    "temperature": "Temperature",
    "ageing": "Ageing",
    "strings": "Strings and inverters",
    "solver": "Solver and energy balance",
}
"""Heading of each group, in the order of every table."""


@dataclass(frozen=True)
class Kpi:
    """Description of one KPI.

    Attributes
    ----------
    label : str
        Name in tables and figures.
    unit : str
        Unit of the value as shown; empty for counts and ratios.
    better : {"min", "max"} or None
        Preferred direction; None if there is none.
    decimals : int or None
        Decimal places; None selects scientific notation, such as ``1.2e-09``.
    meaning : str
        One sentence.
    group : str
        Group, which determines the heading.
    detail : bool
        Whether only complete tables show it.
    factor : float
        Display factor, such as 100 for a ratio shown in per cent.
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
        """Return the value as shown, without its unit; a dash for NaN."""
        if math.isnan(value):
            return "–"
        if self.decimals is None:
            return f"{self.factor * value:.1e}"
        # Adding zero turns a rounded -0.0 into 0.0.
        return f"{round(self.factor * value, self.decimals) + 0.0:,.{self.decimals}f}"

    def quantity(self, value: float) -> str:
        """Return the value as shown, with its unit."""
        return f"{self.number(value)} {self.unit}".rstrip()


def _energy(label: str, meaning: str, better: Direction | None = "min", *, detail: bool = False) -> Kpi:
    return Kpi(label, "kWh", better, 1, meaning, "energy", detail)


def _loss(label: str, meaning: str, better: Direction = "min") -> Kpi:
    return Kpi(label, "kWh", better, 1, meaning, "losses")


def _money(label: str, meaning: str, better: Direction | None = "min") -> Kpi:
    return Kpi(label, "EUR", better, 2, meaning, "money")


def _efficiency(label: str, meaning: str) -> Kpi:
    return Kpi(label, "%", "max", 2, meaning, "efficiency")


def _between_strings(label: str, unit: str, decimals: int, what: str) -> Iterable[tuple[str, Kpi]]:
    for moment, when, detail in (
        ("start", "at the start", True),
        ("end", "at the end", False),
        ("mean", "mean over the run", True),
        ("max", "maximum over the run", False),
    ):
        better: Direction | None = None if moment == "start" else "min"
        meaning = f"Difference between the highest and the lowest {what} of the strings, {when}."
        yield moment, Kpi(f"{label}, {when}", unit, better, decimals, meaning, "strings", detail)


def _over_steps(
    name: str, label: str, unit: str, decimals: int, what: str, factor: float = 1.0
) -> dict[str, Kpi]:
    parts = (("median", "median"), ("p95", "95th percentile"), ("max", "maximum"))
    return {
        f"{name}_{part}": Kpi(
            f"{label}, {text}", unit, "min", decimals, f"{what}, {text} over all steps with a solver call.",
            "solver", part == "p95", factor,
        )
        for part, text in parts
    }  # fmt: skip


CATALOGUE: Final[dict[str, Kpi]] = {
    "demand_kwh": _energy("Energy demand", "Energy demand on the plant: charge plus discharge.", None),
    "charged_kwh": _energy("Charged", "Energy charged at the AC side.", None),
    "discharged_kwh": _energy("Discharged", "Energy discharged at the AC side.", None),
    "delivered_kwh": _energy(
        "Delivered", "Energy delivered at the AC side: charge plus discharge.", "max", detail=True
    ),
    "fulfilment_pct": Kpi(
        "Demand fulfilment", "%", "max", 2, "Delivered energy over energy demand.", "energy"
    ),
    "undelivered_kwh": _loss(
        "Undelivered",
        "Energy set for the strings and not delivered: availability loss plus derating loss.",
    ),
    "availability_loss_kwh": _loss(
        "Availability loss",
        "Undelivered energy because a string was full, empty or at its voltage or current limit.",
    ),
    "derating_loss_kwh": _loss(
        "Derating loss", "Undelivered energy because derating reduced the power of a hot string."
    ),
    "unmet_kwh": _loss(
        "Unmet demand",
        "Demand above the nominal power of the inverters in service; no string has a set-point for it.",
    ),
    "reactive_demand_kvarh": Kpi(
        "Reactive energy demand", "kvarh", None, 1,
        "Reactive power demand on the plant, integrated over time.", "energy",
    ),
    "reactive_kvarh": Kpi(
        "Reactive energy delivered", "kvarh", "max", 1,
        "Reactive power of the inverters, integrated over time; active power has priority.", "energy",
    ),
    "inverter_loss_kwh": _loss("Inverter loss", "Losses in the inverters, including standby."),
    "battery_loss_kwh": _loss("Battery loss", "Ohmic losses in the internal resistance of the batteries."),
    "hysteresis_loss_kwh": _loss(
        "Hysteresis loss",
        "Loss because the open-circuit voltage is lower in discharge than in charge; not included in the "
        "losses above.",
    ),
    "auxiliary_kwh": _loss(
        "Auxiliary energy", "Energy consumption of the cooling system: fans or pumps, and the cold source."
    ),
    "lost_kwh": _loss("Undelivered + losses", "Undelivered energy plus inverter and battery losses."),
    "gain_kwh": _loss(
        "Gain over the best rule",
        "Undelivered energy and losses of the best rule on the same demand, minus those of this run; only "
        "after a report.",
        "max",
    ),
    "gain_stored_kwh": _energy(
        "Stored energy over the best rule",
        "Stored energy at the end, minus that of the best rule on the same demand; only after a report.",
        None, detail=True,
    ),
    "request_kwh": _energy(
        "Set-points", "Energy of the set-points of all strings: charge plus discharge.", None, detail=True
    ),
    "imbalance_kwh": _energy(
        "Dispatch deviation",
        "Sum of the magnitudes of expected minus delivered energy; the dispatch sets the expected energy.",
    ),
    "short_of_charge_kwh": _energy(
        "Charge shortfall", "Charge energy expected by the dispatch and not delivered.", detail=True
    ),
    "short_of_discharge_kwh": _energy(
        "Discharge shortfall", "Discharge energy expected by the dispatch and not delivered.", detail=True
    ),
    "net_eur": _money(
        "Net income",
        "Discharge and capacity revenue minus charge, shortfall, penalty, wear, start and auxiliary costs.",
        "max",
    ),
    "gain_eur": _money(
        "Net gain over the best rule",
        "Net income minus the highest net income of a rule on the same demand; only after a report.", "max",
    ),
    "discharge_revenue_eur": _money(
        "Discharge revenue", "Discharged energy times price minus fee.", "max"
    ),
    "capacity_revenue_eur": _money(
        "Capacity revenue", "Reserve capacity payments, or demand charge saved by a lower peak import.", "max"
    ),
    "position_revenue_eur": _money(
        "Auction revenue", "Positions of auctions at their price less that of the last market.",
        "max",
    ),
    "charge_cost_eur": _money("Charge cost", "Charged energy times price plus fee; may be negative."),
    "shortfall_eur": _money(
        "Shortfall cost", "Undelivered energy times the magnitude of its price plus a penalty."
    ),
    "penalty_eur": _money(
        "Penalty", "Reserve sold but not available, times its price and the penalty factor of the settlement."
    ),
    "peak_charge_eur": _money(
        "Peak charge", "Increase of the charge of the monthly peaks by the plant; negative for a decrease."
    ),
    "wear_eur": _money("Wear cost", "Cost of battery ageing, by the wear model of the study."),
    "start_eur": _money("Start cost", "Number of inverter starts times the cost of a start."),
    "auxiliary_eur": _money(
        "Auxiliary cost",
        "Cost of auxiliary energy (cooling and standby), at the charging price.",
    ),
    "npv_eur": _money(
        "Net present value",
        "Net income of each year, discounted to the start; for runs longer than a year.", "max",
    ),
    "cash_npv_eur": _money(
        "Cash net present value",
        "Income without wear cost, minus new batteries when installed, plus their residual value at the end, "
        "discounted to the start; for runs longer than a year.", "max",
    ),
    "investment_eur": _money("Investment", "Cost of batteries installed during the run; not part of net."),
    "cycle_wear_eur_mwh": Kpi(
        "Cycle wear per MWh", "EUR/MWh", None, 2,
        "Wear cost of cycle ageing per MWh discharged: the depreciation price.", "ageing",
    ),
    "revenue_eur": Kpi(
        "Revenue", "EUR", "max", 2, "Discharged minus charged energy, each times its price.", "money"
    ),
    "system_efficiency_pct": _efficiency(
        "System efficiency", "1 - (inverter + battery loss) / set-point energy."
    ),
    "system_efficiency_with_auxiliaries_pct": _efficiency(
        "System efficiency with auxiliaries",
        "1 - (inverter + battery loss + auxiliary energy) / set-point energy.",
    ),
    "round_trip_efficiency_pct": _efficiency(
        "Round-trip efficiency",
        "Energy exported over energy imported, including standby and auxiliaries, corrected for the change "
        "of stored energy.",
    ),
    "availability_pct": _efficiency(
        "Availability", "1 - availability loss / energy demand."
    ),
    "derating_efficiency_pct": _efficiency(
        "Derating efficiency", "1 - derating loss / set-point energy."
    ),
    "inverter_efficiency_pct": _efficiency(
        "Inverter efficiency", "1 - inverter loss / set-point energy."
    ),
    "battery_efficiency_pct": _efficiency(
        "Battery efficiency", "1 - battery loss / set-point energy."
    ),
    "peak_mean_temperature_c": Kpi(
        "Peak mean temperature", "°C", "min", 1,
        "Maximum over time of the mean temperature of all strings.", "temperature",
    ),
    "peak_string_temperature_c": Kpi(
        "Peak string temperature", "°C", "min", 1, "Maximum mean temperature of any string.", "temperature"
    ),
    "peak_node_temperature_c": Kpi(
        "Hottest node", "°C", "min", 1, "Maximum temperature of any node along the air path.", "temperature"
    ),
    **{
        f"temperature_spread_{moment}_k": kpi
        for moment, kpi in _between_strings("Temperature spread", "K", 1, "mean temperature")
    },
    **{f"soc_spread_{moment}": kpi for moment, kpi in _between_strings("SOC spread", "", 3, "SOC")},
    "outside_window_h": Kpi(
        "Insufficient reserve energy", "h", "min", 2,
        "Time in which the stored energy could not sustain the full reserve for its duration.", "service",
    ),
    "response_kwh": Kpi(
        "FCR activated energy", "kWh", None, 1,
        "Energy activated by the grid frequency: charge plus discharge.", "service",
    ),
    "peak_before_kw": Kpi(
        "Peak import without the plant", "kW", None, 1, "Maximum grid import without the plant.",
        "service",
    ),
    "peak_draw_kw": Kpi("Peak import", "kW", "min", 1, "Maximum grid import.", "service"),
    "above_limit_kwh": Kpi(
        "Import above the limit", "kWh", "min", 2, "Grid import above the limit of the grid connection.",
        "service",
    ),
    "import_kwh": Kpi("Grid import", "kWh", "min", 1, "Energy imported through the meter.", "service"),
    "export_kwh": Kpi("Grid export", "kWh", None, 1, "Energy exported through the meter.", "service"),
    "curtailed_kwh": Kpi(
        "Curtailment", "kWh", "min", 1, "Generation above the limit of the grid export.", "service"
    ),
    "self_consumption_pct": Kpi(
        "Self-consumption", "%", "max", 2,
        "Share of the generation that is neither exported nor curtailed.", "service",
    ),
    "self_sufficiency_pct": Kpi(
        "Self-sufficiency", "%", "max", 2, "Share of the load that is not imported.", "service"
    ),
    "soh_capacity_min": Kpi(
        "Lowest SOH", "", "max", 4,
        "Capacity at the end relative to the system file, of the string with the lowest.", "ageing",
    ),
    "soh_capacity_mean": Kpi(
        "Mean SOH", "", "max", 4,
        "Capacity at the end relative to the system file, mean over the strings.", "ageing",
    ),
    "soh_resistance_max": Kpi(
        "Highest relative resistance", "", "min", 4,
        "Resistance at the end relative to the system file, of the string with the highest.", "ageing",
    ),
    "budget_used_pct": Kpi(
        "Budget used", "%", None, 2,
        "Maximum used share of an annual budget of cycles or throughput.", "ageing",
    ),
    "contract_round_trip_efficiency_margin": Kpi(
        "Round trip above guarantee", "%", "max", 2,
        "Round-trip efficiency minus the guaranteed one, in percentage points.", "ageing",
    ),
    "contract_availability_margin": Kpi(
        "Availability above guarantee", "%", "max", 2,
        "Demand fulfilment minus the guaranteed availability, in percentage points.", "ageing",
    ),
    "contract_throughput_left_mwh": Kpi(
        "Throughput left", "MWh", "max", 1, "Contracted throughput minus the energy discharged.", "ageing"
    ),
    "end_of_life_days": Kpi(
        "First end of life", "d", "max", 1,
        "Days until the first string reached its end-of-life capacity.", "ageing",
    ),
    "full_cycles": Kpi(
        "Equivalent full cycles", "", None, 2, "Half of the total SOC change, mean over the strings.",
        "strings",
    ),
    "inverter_starts_mean": Kpi(
        "Starts per inverter", "", "min", 1, "Off-to-on transitions, mean over the inverters.", "strings"
    ),
    "inverter_starts_max": Kpi(
        "Maximum starts per inverter", "", "min", 0, "Off-to-on transitions of the inverter with the most.",
        "strings", True,
    ),
    "starts_per_day": Kpi(
        "Starts per day", "", "min", 1, "Off-to-on transitions of all inverters per day.", "strings"
    ),
    "ledger_residual_ratio": Kpi(
        "Relative energy-balance error", "", None, None,
        "Residual of the plant's energy balance over delivered energy; only rounding errors are expected.",
        "solver",
    ),
    "fallback_steps": Kpi(
        "Fallback steps", "", "min", 0, "Steps in which a fallback replaced the optimisation result.",
        "solver",
    ),
    "solver_steps": Kpi("Solved steps", "", None, 0, "Steps with a solver call.", "solver"),
    "plan_search_gap_pct": Kpi(
        "Search gap of plans", "%", None, 2,
        "Median gap of the plans with bounds to an estimated lower bound from shadow prices.", "solver",
    ),
    "plan_gap_pct": Kpi(
        "Rigorous gap of plans", "%", None, 2,
        "Median gap of the plans with bounds to a rigorous lower bound of the control model with the "
        "coefficients of the start of each step.", "solver",
    ),
    **_over_steps(
        "solver_gap", "Rigorous gap", "%", 3,
        "Gap of the split to a rigorous lower bound of the control model", 100.0,
    ),
    **_over_steps(
        "solver_search_gap", "Search gap", "%", 3,
        "Gap of the split to the bound of the convexified program, the stopping criterion", 100.0,
    ),
    **_over_steps("solver_nodes", "Nodes", "", 0, "Conic programs solved per step"),
    **_over_steps("solve_time_s", "Solve time", "ms", 1, "Wall-clock solve time per step", 1000.0),
}  # fmt: skip
"""All KPIs, by their names in :func:`bess.kpis`."""


def kpi(name: str) -> Kpi:
    """Return the entry of a KPI; an unlisted KPI (of a plug-in) is labelled with its name."""
    return CATALOGUE.get(name) or Kpi(name, "", None, 3, "", "strings", detail=True)


def better(name: str) -> Direction:
    """Return the preferred direction of a KPI."""
    direction = kpi(name).better
    if direction is None:
        raise InputError(f"{name}: this KPI has no preferred direction; choose another KPI")
    return direction


def grouped(names: Iterable[str]) -> dict[str, list[str]]:
    """Return KPI names by group heading, in the order of the catalogue.

    Unlisted KPIs come last within their group.
    """
    places = {name: place for place, name in enumerate(CATALOGUE)}
    ordered = sorted(dict.fromkeys(names), key=lambda name: places.get(name, len(places)))
    groups = {
        heading: [name for name in ordered if kpi(name).group == group] for group, heading in HEADINGS.items()
    }
    return {heading: members for heading, members in groups.items() if members}
