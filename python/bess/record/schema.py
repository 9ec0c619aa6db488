"""Variables of a result, as in the table of ``ARCHITECTURE.md``: dimensions, units, meaning, type on disk."""

from __future__ import annotations

from dataclasses import dataclass

RECORD_FORMAT = 2
"""Number of the layout of a run directory; a run of another layout is not continued."""


@dataclass(frozen=True)
class Variable:
    """One variable of the result."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    dtype: str = "f8"


_T = ("time",)
_TS = ("time", "string")

VARIABLES: dict[str, Variable] = {
    "demand_kw": Variable(_T, "kW", "power asked of the plant, positive = discharge"),
    "reactive_demand_kvar": Variable(_T, "kvar", "reactive power asked of the plant, positive = given"),
    "unmet_kw": Variable(_T, "kW", "part of the demand above the power in service, asked of no string"),
    "price_eur_mwh": Variable(_T, "EUR/MWh", "market price"),
    "expected_kw": Variable(_T, "kW", "power that the dispatch expected to be delivered"),
    "frequency_mhz": Variable(_T, "mHz", "deviation from the nominal grid frequency, mean over the step"),
    "response_kw": Variable(_T, "kW", "part of the demand that answers the frequency"),
    "schedule_kw": Variable(_T, "kW", "part of the demand that was agreed on ahead: recharge and trade"),
    "capacity_kw": Variable(_T, "kW", "reserve that was sold"),
    "capacity_able_kw": Variable(
        _T, "kW", "reserve that the store sustains for the required duration, at the start of the step"
    ),
    "capacity_price_eur_mw_h": Variable(_T, "EUR/MW/h", "price of reserve"),
    "soc_low": Variable(_T, "1", "SOC below which the reserve is not sustained"),
    "soc_high": Variable(_T, "1", "SOC above which the reserve is not sustained"),
    "load_kw": Variable(_T, "kW", "what the load behind the meter draws"),
    "generation_kw": Variable(_T, "kW", "what is generated behind the meter"),
    "grid_limit_kw": Variable(_T, "kW", "limit of what the grid connection draws"),
    "export_price_eur_mwh": Variable(_T, "EUR/MWh", "price of what the meter gives"),
    "demand_charge_eur_kw_h": Variable(_T, "EUR/kW/h", "price of the highest draw of the grid connection"),
    "ambient_c": Variable(_T, "degC", "ambient (air inlet) temperature"),
    "request_kw": Variable(_TS, "kW", "set-point of each string (AC), positive = discharge"),
    "delivered_kw": Variable(_TS, "kW", "delivered AC power, mean over the step, positive = discharge"),
    "reactive_kvar": Variable(_TS, "kvar", "reactive power carried, mean over the step, positive = given"),
    "availability_loss_kw": Variable(_TS, "kW", "requested, not delivered: SOC, voltage and root limits"),
    "derating_loss_kw": Variable(_TS, "kW", "requested, not delivered: temperature derating"),
    "inverter_loss_kw": Variable(_TS, "kW", "inverter loss"),
    "standby_kw": Variable(
        _TS,
        "kW",
        "inverter loss taken from the grid beside the delivered power: standby, or reactive power",
    ),
    "battery_loss_kw": Variable(_TS, "kW", "heat in the battery"),
    "hysteresis_loss_kw": Variable(_TS, "kW", "loss by the hysteresis of the open-circuit voltage"),
    "chemical_kw": Variable(_TS, "kW", "power taken from the chemical store, a function of SOC"),
    "auxiliary_kw": Variable(_T, "kW", "power of cooling (fans, pumps, chiller), taken from the grid"),
    "cooling_kw": Variable(_TS, "kW", "heat carried off by the coolant"),
    "coolant_c": Variable(_T, "degC", "temperature of the coolant at the inlet, at the end of the step"),
    "reversible_heat_kw": Variable(_TS, "kW", "heat of reaction -I T dU/dT, negative where it cools"),
    "current_a": Variable(_TS, "A", "mean string current, positive = discharge"),
    "soc": Variable(_TS, "1", "state of charge at the end of the step"),
    "temperature_c": Variable(_TS, "degC", "mean temperature over the nodes at the end of the step"),
    "node_max_c": Variable(_TS, "degC", "temperature of the hottest node within the step"),
    "node_temperature_c": Variable(
        ("time", "string", "node"), "degC", "node temperature at the end of the step", "f4"
    ),
    "derating_factor": Variable(_TS, "1", "derating factor, mean over the step"),
    "limits": Variable(_TS, "1", "limits that bound within the step", "i4"),
    "inverter_starts": Variable(_TS, "1", "off-to-on transitions within the step", "i4"),
    "soh_capacity": Variable(_TS, "1", "capacity over that of the system file, at the end of the step"),
    "soh_resistance": Variable(_TS, "1", "resistance over that of the system file, at the end of the step"),
    "calendar_loss": Variable(_TS, "1", "capacity lost by standing, at the end of the step"),
    "cyclic_loss": Variable(_TS, "1", "capacity lost by cycling, at the end of the step"),
    "aged_charge_ah": Variable(_TS, "Ah", "charge that went with capacity: SOC times the capacity lost"),
    "wear_eur": Variable(_TS, "EUR", "cost of wear within the step"),
    "end_of_life": Variable(_TS, "1", "1 where the capacity first falls to the end of life", "i4"),
    "ledger_residual_kwh": Variable(
        _T, "kWh", "AC energy - (chemical change + heat + hysteresis + inverter loss) of all strings"
    ),
    "solver_status": Variable(_T, "1", "outcome of the policy's optimisation", "i4"),
    "solver_gap": Variable(_T, "1", "relative gap to the rigorous bound"),
    "solver_search_gap": Variable(_T, "1", "relative gap of the convexified program"),
    "solver_nodes": Variable(_T, "1", "branch-and-bound nodes", "i4"),
    "fallback": Variable(_T, "1", "1 where a fallback took the place of the optimiser's answer", "i4"),
}

FLOWS = (
    "delivered_kw",
    "availability_loss_kw",
    "derating_loss_kw",
    "inverter_loss_kw",
    "standby_kw",
    "battery_loss_kw",
    "hysteresis_loss_kw",
    "chemical_kw",
    "current_a",
    "soc",
    "temperature_c",
    "node_max_c",
    "derating_factor",
    "limits",
    "inverter_starts",
    "soh_capacity",
    "soh_resistance",
    "ledger_residual_kwh",
)
"""Variables that come from the plant as they are."""

COOLING_FLOWS = ("auxiliary_kw", "cooling_kw", "coolant_c")
"""The same, of plants with a section ``[cooling]`` only."""

ENTROPY_FLOWS = ("reversible_heat_kw",)
"""The same, of plants with a table of entropy only."""

REACTIVE_FLOWS = ("reactive_kvar",)
"""The same, of studies that ask for reactive power only."""

AGEING_FLOWS = ("calendar_loss", "cyclic_loss", "aged_charge_ah")
"""The same, of plants with a cell model of ageing only."""
