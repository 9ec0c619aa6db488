"""Results as charts: each function only selects and arranges data; drawing is elsewhere."""

from bess.report.charts.durations import duration_curves
from bess.report.charts.health import state_of_health
from bess.report.charts.market import market_dispatch
from bess.report.charts.power import power_split
from bess.report.charts.reactive import reactive_power
from bess.report.charts.services import service
from bess.report.charts.solver import solver_effort
from bess.report.charts.strings import string_spread, strings
from bess.report.charts.sweeps import kpi_lines, pareto_front
from bess.report.charts.thermal import derating_curves, mean_temperature

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
