"""Key figures as a table of plain text."""

from __future__ import annotations

from collections.abc import Mapping

_ROWS = {
    "availability_pct": ("availability", "%", 2),
    "derating_efficiency_pct": ("derating efficiency", "%", 2),
    "inverter_efficiency_pct": ("inverter efficiency", "%", 2),
    "battery_efficiency_pct": ("battery efficiency", "%", 2),
    "system_efficiency_pct": ("system efficiency", "%", 2),
    "fulfilment_pct": ("demand fulfilled", "%", 2),
    "peak_mean_temperature_c": ("peak of the mean temperature", "degC", 1),
    "peak_string_temperature_c": ("peak temperature of a string", "degC", 1),
    "peak_node_temperature_c": ("hottest node", "degC", 1),
    "soc_spread_start": ("SOC spread at the start", "", 3),
    "soc_spread_end": ("SOC spread at the end", "", 3),
    "soc_spread_max": ("largest SOC spread", "", 3),
    "full_cycles": ("full cycles", "", 2),
    "inverter_starts_mean": ("starts of an inverter", "", 1),
    "delivered_kwh": ("energy delivered (both ways)", "kWh", 1),
    "unmet_kwh": ("demand above the plant", "kWh", 1),
    "revenue_eur": ("revenue", "EUR", 2),
    "ledger_residual_ratio": ("ledger residual / energy", "", -1),
    "fallback_steps": ("fallback steps", "", 0),
    "solver_steps": ("steps with a solve", "", 0),
    "solver_gap_median": ("gap, median", "", -1),
    "solver_gap_p95": ("gap, 95th percentile", "", -1),
    "solver_gap_max": ("gap, worst", "", -1),
    "solver_nodes_median": ("nodes, median", "", 0),
    "solver_nodes_max": ("nodes, worst", "", 0),
    "solve_time_s_median": ("solve time, median", "s", 4),
    "solve_time_s_p95": ("solve time, 95th percentile", "s", 4),
    "solve_time_s_max": ("solve time, worst", "s", 4),
}


def kpi_table(kpis: Mapping[str, Mapping[str, float]]) -> str:
    """Return one column for each run; figures that no run has are left out."""
    rows = [["", "", *kpis]]
    for name, (label, unit, decimals) in _ROWS.items():
        if any(name in values for values in kpis.values()):
            rows.append([label, unit, *(_shown(values.get(name), decimals) for values in kpis.values())])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        left = [cell.ljust(width) for cell, width in zip(row[:2], widths[:2], strict=True)]
        right = [cell.rjust(width) for cell, width in zip(row[2:], widths[2:], strict=True)]
        lines.append("  ".join(left + right).rstrip())
    return "\n".join(lines)


def _shown(value: float | None, decimals: int) -> str:
    if value is None:
        return "-"
    return f"{value:.1e}" if decimals < 0 else f"{value:.{decimals}f}"
