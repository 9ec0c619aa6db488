"""Figures for papers and slides: each a function from a result (or results by name) to a matplotlib figure.

Nothing is read from or written to disk here, and the caller's matplotlib settings are left alone. Save with
:func:`bess.report.save_figure`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

from matplotlib.figure import Figure

from bess.report import charts
from bess.report.charts.calendar import heat_maps, monthly_bars
from bess.report.charts.kpi_figures import kpi_bars, kpi_radar
from bess.report.charts.losses import energy_flow, losses_compared
from bess.report.charts.maps import inverter_pattern, node_temperatures
from bess.report.drawing.chart import Chart
from bess.report.drawing.draw import draw

P = ParamSpec("P")


def _drawn(chart: Callable[P, Chart]) -> Callable[P, Figure]:
    """Return the figure of a chart function, with its arguments and documentation."""

    @wraps(chart)
    def figure(*args: P.args, **kwargs: P.kwargs) -> Figure:
        return draw(chart(*args, **kwargs))

    figure.__annotations__ = {**chart.__annotations__, "return": Figure}
    return figure


duration_curves = _drawn(charts.duration_curves)
strings = _drawn(charts.strings)
string_spread = _drawn(charts.string_spread)
mean_temperature = _drawn(charts.mean_temperature)
derating_curves = _drawn(charts.derating_curves)
power_split = _drawn(charts.power_split)
reactive_power = _drawn(charts.reactive_power)
solver_effort = _drawn(charts.solver_effort)
state_of_health = _drawn(charts.state_of_health)
market_dispatch = _drawn(charts.market_dispatch)
service = _drawn(charts.service)
kpi_lines = _drawn(charts.kpi_lines)
pareto_front = _drawn(charts.pareto_front)

__all__ = [
    "derating_curves",
    "duration_curves",
    "energy_flow",
    "heat_maps",
    "inverter_pattern",
    "kpi_bars",
    "kpi_lines",
    "kpi_radar",
    "losses_compared",
    "market_dispatch",
    "mean_temperature",
    "monthly_bars",
    "node_temperatures",
    "pareto_front",
    "power_split",
    "reactive_power",
    "service",
    "solver_effort",
    "state_of_health",
    "string_spread",
    "strings",
]
