"""Figures for papers and slides: each a function from a result (or results by name) to a matplotlib figure.

These functions neither read nor write files, and keep the caller's matplotlib settings. Save with
:func:`bess.report.save_figure`. ``result.plot`` draws the same figures in a notebook.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bess.report.charts import kpi_figures, maps, operation
from bess.report.drawing.chart import Chart, draw
from bess.report.drawing.style import through_pyplot

if TYPE_CHECKING:
    from bess.simulation.record import Result


P = ParamSpec("P")
T = TypeVar("T")


def _drawn(chart: Callable[P, Chart]) -> Callable[P, Figure]:
    """Return the figure of a chart function, with its arguments and documentation."""

    @wraps(chart)
    def figure(*args: P.args, **kwargs: P.kwargs) -> Figure:
        return draw(chart(*args, **kwargs))

    figure.__annotations__ = {**chart.__annotations__, "return": Figure}
    return figure


duration_curves = _drawn(operation.duration_curves)
strings = _drawn(operation.strings)
string_spread = _drawn(operation.string_spread)
mean_temperature = _drawn(operation.mean_temperature)
derating_curves = _drawn(operation.derating_curves)
power_split = _drawn(operation.power_split)
reactive_power = _drawn(operation.reactive_power)
solver_effort = _drawn(operation.solver_effort)
state_of_health = _drawn(operation.state_of_health)
market_dispatch = _drawn(operation.market_dispatch)
service = _drawn(operation.service)
kpi_lines = _drawn(kpi_figures.kpi_lines)
pareto_front = _drawn(kpi_figures.pareto_front)

energy_flow = kpi_figures.energy_flow
kpi_bars = kpi_figures.kpi_bars
kpi_radar = kpi_figures.kpi_radar
losses_compared = kpi_figures.losses_compared
heat_maps = maps.heat_maps
inverter_pattern = maps.inverter_pattern
monthly_bars = maps.monthly_bars
node_temperatures = maps.node_temperatures


Panels = NDArray[Any]
"""Axes of a figure, from top to bottom and left to right."""


def _method(make: Callable[..., Figure], shown: Callable[[list[Axes]], T]) -> Callable[[Plot], T]:
    def method(self: Plot) -> T:
        with through_pyplot():
            return shown(make(self.result).axes)

    method.__name__, method.__doc__ = make.__name__, make.__doc__
    return method


_panels = partial(_method, shown=lambda axes: np.array(axes, dtype=object))
_axes = partial(_method, shown=lambda axes: axes[0])


class Plot:
    """Figures of one result. Calling it draws the state of the strings.

    Each method returns matplotlib axes (an array of them where a figure has several), so that a title, a
    limit or a line can be added, and the figure saved with ``axes.figure.savefig``.
    """

    def __init__(self, result: Result) -> None:
        self.result = result

    strings = __call__ = _panels(strings)
    power = _panels(power_split)
    losses = _axes(energy_flow)
    temperature = _axes(mean_temperature)
    spread = _panels(string_spread)
    durations = _panels(duration_curves)
    inverters = _axes(inverter_pattern)
    market = _panels(market_dispatch)
    service = _panels(service)
    reactive = _panels(reactive_power)
    heat_map = _panels(heat_maps)
    months = _panels(monthly_bars)
    solver = _panels(solver_effort)
