"""Branching of the branch and bound: at a request, at an SOC, or on the availability loss of a string.

The best branching raises the bounds of both parts most. The first branching of each kind, string and step is
evaluated (strong branching). The gain of later ones is estimated from earlier gains per width (pseudo-costs).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.arrays import Array
from bess.control.split.tree import Part, Solved
from bess.units import WATTS_PER_KW

LEAST_KW = 1.0 / WATTS_PER_KW
"""Request that separates a node with the inverter off from a node with the inverter on [kW]."""

INNER_SHARE = 0.2
"""Minimum distance of a cut from the ends of its range, as a share of the range."""

FRACTIONAL = 1e-2
"""A binary within this distance of 0 or 1 is fixed."""

SMALLEST_WIDTH = 1e-3
"""Minimum width of a request range, relative to nominal power."""

SMALLEST_SOC = 1e-4
"""Minimum width of an SOC range."""

LOW_SOC = 0.05
"""SOC widths are relative to the SOC, or to this value at a lower SOC, where the resistance rises."""

SMALLEST_GAIN = 1e-6
"""Minimum rated gain of a part, as a share of the bound: a cut that closes the other part then rates well."""


@dataclass(frozen=True)
class Cut:
    """A branching of a node into two parts.

    Attributes
    ----------
    kind : {"switch", "request", "full", "soc"}
        ``"switch"``: inverter off or on. ``"request"``: request below or above a value [kW]. ``"full"``: no
        availability loss, or full (empty) at the end of the step. ``"soc"``: SOC at the start of the step.
    string, step : int
    at : float
        Request or SOC.
    width : float
        Relative width of the range.
    """

    kind: Literal["switch", "request", "full", "soc"]
    string: int
    step: int
    at: float
    width: float

    def parts(self, node: _core.Node) -> tuple[_core.Node, _core.Node]:
        """Cut a node."""
        if self.kind == "full":
            return node.branch_on_full(self.string, self.step)
        cut = node.branch_on_soc if self.kind == "soc" else node.branch_on_request
        return cut(self.string, self.step, self.at)


@dataclass(frozen=True)
class NodePoint:
    """Optimum of a node's relaxation; arrays ``(n_strings, n_steps)``.

    Attributes
    ----------
    request_kw, soc : ndarray
        Magnitudes, and SOC at the start of each step.
    on, full : ndarray
        Binaries.
    """

    request_kw: Array
    soc: Array
    on: Array
    full: Array

    @classmethod
    def middle(cls, node: _core.Node) -> NodePoint:
        """Midpoint of a node that could not be solved."""
        boxes = node.boxes
        request_kw = 0.5 * (node.request_low_kw + node.request_high_kw)
        soc = 0.5 * (boxes.soc_low + boxes.soc_high)[:, :-1]
        return cls(request_kw, soc, np.ones(soc.shape), np.ones(soc.shape))

    def cuts(self, node: _core.Node, nominal_kw: Array, may_end_otherwise: NDArray[np.bool_]) -> list[Cut]:
        """Cuts of a node at this point.

        Parameters
        ----------
        node
            Node with tightened bounds.
        nominal_kw : ndarray, shape (n_strings,)
        may_end_otherwise : ndarray of bool, shape (n_strings, n_steps)
            Whether a schedule of the node may end without being full (empty) enough for availability loss.
        """
        low_kw, high_kw, boxes = node.request_low_kw, node.request_high_kw, node.boxes
        soc_low, soc_high = boxes.soc_low, boxes.soc_high
        cuts = []
        for string, step in np.ndindex(self.request_kw.shape):
            place = (string, step)
            low, high = float(low_kw[place]), float(high_kw[place])
            width = (high - low) / float(nominal_kw[string])
            if width > SMALLEST_WIDTH and low < LEAST_KW < high and self.on[place] < 1.0 - FRACTIONAL:
                cuts.append(Cut("switch", string, step, LEAST_KW, width))
            elif width > SMALLEST_WIDTH:
                cuts.append(
                    Cut("request", string, step, _inside(float(self.request_kw[place]), low, high), width)
                )
            if may_end_otherwise[place] and FRACTIONAL < self.full[place] < 1.0 - FRACTIONAL:
                cuts.append(Cut("full", string, step, np.nan, 1.0))
            low, high = float(soc_low[place]), float(soc_high[place])
            if high - low > SMALLEST_SOC:
                width = (high - low) / max(float(self.soc[place]), LOW_SOC)
                cuts.append(Cut("soc", string, step, _inside(float(self.soc[place]), low, high), width))
        return cuts


class Branching:
    """Choice of the best cut, with the gains of earlier cuts."""

    def __init__(self, solve: Callable[[_core.Node], Solved[_core.Node]]) -> None:
        self._solve = solve
        self._gain_per_width: dict[tuple[str, int, int], float] = {}

    def best(
        self, node: _core.Node, bound: float, cuts: list[Cut], is_over: Callable[[], bool]
    ) -> list[Part[_core.Node]]:
        """Branch a node with this bound; parts solved by strong branching include their answers."""
        best_gain, best, parts = -1.0, cuts[0], None
        for cut in cuts:
            place = (cut.kind, cut.string, cut.step)
            tried = None
            if place not in self._gain_per_width and not is_over():
                tried = [Part(part, self._solve(part)) for part in cut.parts(node)]
                floor = SMALLEST_GAIN * abs(bound)
                gains = [max(part.solved.bound - bound, floor) for part in tried if part.solved]
                self._gain_per_width[place] = float(np.sqrt(np.prod(gains))) / cut.width
            gain = self._gain_per_width.get(place, 0.0) * cut.width
            if gain > best_gain:
                best_gain, best, parts = gain, cut, tried
        return parts if parts is not None else [Part(part) for part in best.parts(node)]


def _inside(at: float, low: float, high: float) -> float:
    margin = INNER_SHARE * (high - low)
    return float(min(max(at, low + margin), high - margin))
