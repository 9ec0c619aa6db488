"""``result.plot``: figures of a result in a notebook, as matplotlib axes that one may change."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bess.report import figures
from bess.report.drawing.style import through_pyplot

if TYPE_CHECKING:
    from bess.simulation.record import Result

Panels = NDArray[Any]
"""Axes of a figure, from top to bottom and left to right."""


class Plot:
    """Figures of one result. Calling it draws the state of the strings.

    Each method returns matplotlib axes (an array of them where a figure has several), so that a title, a
    limit or a line can be added, and the figure saved with ``axes.figure.savefig``.
    """

    def __init__(self, result: Result) -> None:
        self._result = result

    def __call__(self) -> Panels:
        """State of charge and temperature of every string, demand behind."""
        return self.strings()

    def strings(self) -> Panels:
        """State of charge and temperature of every string, demand behind."""
        return _panels(lambda: figures.strings(self._result))

    def power(self) -> Panels:
        """Requested, delivered and undelivered power and losses of every string."""
        return _panels(lambda: figures.power_split(self._result))

    def losses(self) -> Axes:
        """Loss breakdown: energy flow between grid and battery, with the losses of each direction."""
        return _single(lambda: figures.energy_flow(self._result))

    def temperature(self) -> Axes:
        """Mean temperature of the storage."""
        return _single(lambda: figures.mean_temperature(self._result))

    def spread(self) -> Panels:
        """Largest minus smallest state of charge and temperature of the strings."""
        return _panels(lambda: figures.string_spread(self._result))

    def durations(self) -> Panels:
        """Duration curves of power and temperature."""
        return _panels(lambda: figures.duration_curves(self._result))

    def inverters(self) -> Axes:
        """Inverter states over time."""
        return _single(lambda: figures.inverter_pattern(self._result))

    def market(self) -> Panels:
        """Price, dispatch and state of charge, for studies with prices."""
        return _panels(lambda: figures.market_dispatch(self._result))

    def service(self) -> Panels:
        """Demand and compliance of a grid service, for studies of services."""
        return _panels(lambda: figures.service(self._result))

    def reactive(self) -> Panels:
        """Reactive power demand and supply, for studies with reactive power."""
        return _panels(lambda: figures.reactive_power(self._result))

    def heat_map(self) -> Panels:
        """Days across, hours up: power, state of charge, temperature, price."""
        return _panels(lambda: figures.heat_maps(self._result))

    def months(self) -> Panels:
        """Net income, energy, losses and cycles of each month."""
        return _panels(lambda: figures.monthly_bars(self._result))

    def solver(self) -> Panels:
        """Effort and gaps of the optimiser."""
        return _panels(lambda: figures.solver_effort(self._result))


def _panels(make: Callable[[], Figure]) -> Panels:
    with through_pyplot():
        return np.array(make().axes, dtype=object)


def _single(make: Callable[[], Figure]) -> Axes:
    axes: Axes = _panels(make)[0]
    return axes
