"""Variables of a result, as in the table of ``ARCHITECTURE.md``: dimensions, units, meaning, type on disk."""

from __future__ import annotations

from dataclasses import dataclass

RECORD_FORMAT = 2
"""Version of the layout of a run directory; a run with another version is not continued."""


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
    "demand_kw": Variable(_T, "kW", "power demand on the plant, positive = discharge"),
    "reactive_demand_kvar": Variable(_T, "kvar", "reactive power demand on the plant, positive = supplied"),
    "unmet_kw": Variable(_T, "kW", "demand above the inverter power in service"),
    "price_eur_mwh": Variable(_T, "EUR/MWh", "market price"),
    "position_kw": Variable(
        ("time", "market"), "kW", "position in each auction before the last market, sold"
    ),
    "auction_price_eur_mwh": Variable(("time", "market"), "EUR/MWh", "price of each auction"),
    "expected_kw": Variable(_T, "kW", "delivered power expected by the dispatch"),
    "budget_price_eur_mwh": Variable(_T, "EUR/MWh", "shadow price of the cycle budget, per MWh discharged"),
    "budget_cycles": Variable(_T, "1", "full cycles of the year so far, at the start of the step"),
    "frequency_mhz": Variable(_T, "mHz", "deviation from the nominal grid frequency, mean over the step"),
    "response_kw": Variable(_T, "kW", "frequency response, a part of the demand"),
    "schedule_kw": Variable(_T, "kW", "scheduled part of the demand: recharge and trade"),
    "capacity_kw": Variable(_T, "kW", "sold reserve"),
    "capacity_able_kw": Variable(
        _T, "kW", "reserve that can be sustained for the required duration, at the start of the step"
    ),
    "capacity_price_eur_mw_h": Variable(_T, "EUR/MW/h", "price of reserve"),
    "soc_low": Variable(_T, "1", "SOC below which the reserve is not sustained"),
    "soc_high": Variable(_T, "1", "SOC above which the reserve is not sustained"),
    "load_kw": Variable(_T, "kW", "load behind the meter"),
    "generation_kw": Variable(_T, "kW", "generation behind the meter"),
    "grid_limit_kw": Variable(_T, "kW", "limit of the grid import"),
    "export_price_eur_mwh": Variable(_T, "EUR/MWh", "price of the grid export"),
    "demand_charge_eur_kw_h": Variable(_T, "EUR/kW/h", "price of the peak grid import"),
    "export_limit_kw": Variable(_T, "kW", "limit of the grid export; generation above it is curtailed"),
    "peak_price_eur_kw": Variable(_T, "EUR/kW", "price of the highest quarter-hour mean import of a month"),
    "billing_month": Variable(_T, "1", "month that is billed: year and month, as 202401"),
    "ambient_c": Variable(_T, "degC", "ambient (air inlet) temperature"),
    "request_kw": Variable(_TS, "kW", "set-point of each string (AC), positive = discharge"),
    "delivered_kw": Variable(_TS, "kW", "delivered AC power, mean over the step, positive = discharge"),
    "reactive_kvar": Variable(_TS, "kvar", "reactive power, mean over the step, positive = supplied"),
    "availability_loss_kw": Variable(_TS, "kW", "undelivered request: SOC, voltage and root limits"),
    "derating_loss_kw": Variable(_TS, "kW", "undelivered request: temperature derating"),
    "inverter_loss_kw": Variable(_TS, "kW", "inverter loss"),
    "standby_kw": Variable(
        _TS,
        "kW",
        "inverter loss drawn from the grid in addition to the delivered power: standby, or reactive power",
    ),
    "battery_loss_kw": Variable(_TS, "kW", "battery loss (heat)"),
    "hysteresis_loss_kw": Variable(_TS, "kW", "loss due to hysteresis of the open-circuit voltage"),
    "chemical_kw": Variable(_TS, "kW", "power drawn from the stored chemical energy, a function of SOC"),
    "auxiliary_kw": Variable(_T, "kW", "power of cooling (fans, pumps, chiller), taken from the grid"),
    "cooling_kw": Variable(_TS, "kW", "heat removed by the coolant"),
    "coolant_c": Variable(_T, "degC", "temperature of the coolant at the inlet, at the end of the step"),
    "reversible_heat_kw": Variable(_TS, "kW", "heat of reaction -I T dU/dT, negative = cooling"),
    "current_a": Variable(_TS, "A", "mean string current, positive = discharge"),
    "soc": Variable(_TS, "1", "state of charge at the end of the step"),
    "temperature_c": Variable(_TS, "degC", "mean temperature over the nodes at the end of the step"),
    "node_max_c": Variable(_TS, "degC", "temperature of the hottest node within the step"),
    "node_temperature_c": Variable(
        ("time", "string", "node"), "degC", "node temperature at the end of the step", "f4"
    ),
    "derating_factor": Variable(_TS, "1", "derating factor, mean over the step"),
    "limits": Variable(_TS, "1", "limits that were active within the step", "i4"),
    "inverter_starts": Variable(_TS, "1", "off-to-on transitions within the step", "i4"),
    "soh_capacity": Variable(_TS, "1", "capacity relative to the system file, at the end of the step"),
    "soh_resistance": Variable(_TS, "1", "resistance relative to the system file, at the end of the step"),
    "calendar_loss": Variable(_TS, "1", "capacity loss by calendar ageing, at the end of the step"),
    "cyclic_loss": Variable(_TS, "1", "capacity loss by cycle ageing, at the end of the step"),
    "aged_charge_ah": Variable(_TS, "Ah", "charge lost with capacity: SOC times the capacity loss"),
    "wear_eur": Variable(_TS, "EUR", "wear cost within the step"),
    "end_of_life": Variable(_TS, "1", "1 where the capacity first reaches the end of life", "i4"),
    "investment_eur": Variable(_TS, "EUR", "cost of a new battery, installed at the start of the step"),
    "ledger_residual_kwh": Variable(
        _T, "kWh", "AC energy - (chemical change + heat + hysteresis + inverter loss) of all strings"
    ),
    "solver_status": Variable(_T, "1", "solution status of the policy", "i4"),
    "solver_gap": Variable(_T, "1", "relative gap to the rigorous bound"),
    "solver_search_gap": Variable(_T, "1", "relative gap of the convexified program"),
    "solver_nodes": Variable(_T, "1", "branch-and-bound nodes", "i4"),
    "fallback": Variable(_T, "1", "1 if a fallback replaced the result of the optimiser", "i4"),
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
"""Variables taken directly from the plant."""

COOLING_FLOWS = ("auxiliary_kw", "cooling_kw", "coolant_c")
"""Plant variables of systems with a section ``[cooling]`` only."""

ENTROPY_FLOWS = ("reversible_heat_kw",)
"""Plant variables of systems with a table of entropy only."""

REACTIVE_FLOWS = ("reactive_kvar",)
"""Plant variables of studies with reactive power only."""

AGEING_FLOWS = ("calendar_loss", "cyclic_loss", "aged_charge_ah")
"""Plant variables of systems with an ageing model of the cells only."""
