"""Results as charts: each function only selects and arranges data; drawing is elsewhere."""

from bess.report.charts.kpi_figures import kpi_lines, pareto_front
from bess.report.charts.operation import (
    derating_curves,
    duration_curves,
    market_dispatch,
    mean_temperature,
    power_split,
    reactive_power,
    service,
    solver_effort,
    state_of_health,
    string_spread,
    strings,
)

__all__ = [
    "derating_curves",
    "duration_curves",
    "kpi_lines",
    "market_dispatch",
    "mean_temperature",
    "pareto_front",
    "power_split",
    "reactive_power",
    "service",
    "solver_effort",
    "state_of_health",
    "string_spread",
    "strings",
]
