"""Branching of the branch and bound: at a request, at an SOC, or on the availability loss of a string.

The best branching raises the bounds of both parts most. The gain of a branching of one kind, string and step
is first estimated from the shadow prices of the node; the mean gain per width of solved parts (pseudo-cost)
then replaces the estimate.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.arrays import Array
from bess.control.split.tree import Solved
from bess.units import WATTS_PER_KW

MIN_KW = 1.0 / WATTS_PER_KW
"""Request that separates a node with the inverter off from a node with the inverter on [kW]."""

INNER_SHARE = 0.2
"""Minimum distance of a cut from the ends of its range, as a share of the range."""

FRACTIONAL = 1e-2
"""A binary within this distance of 0 or 1 is fixed."""

MIN_WIDTH = 1e-3
"""Minimum width of a request range, relative to nominal power."""

MIN_SOC = 1e-4
"""Minimum width of an SOC range."""

LOW_SOC = 0.05
"""SOC widths are relative to the SOC, or to this value at a lower SOC, where the resistance rises."""

MIN_GAIN = 1e-6
"""Minimum gain of a part in the rating, as a share of the bound: closing the other part then rates well."""

MAX_ESTIMATES = 16
"""Maximum number of cuts of a node with estimated gains, the widest first. Two estimates take a third of a
solve; 64 cuts close no more of the gap, in up to a sixth more time."""

Place = tuple[str, int, int]
"""Kind, string and step of a cut."""


@dataclass(frozen=True)
class Cut:
    """A branching of a node into two parts."""

    kind: Literal["switch", "request", "full", "soc"]
    """``"switch"``: inverter off or on. ``"request"``: request below or above a value [kW]. ``"full"``: no
    availability loss, or full (empty) at the end of the step. ``"soc"``: SOC at the start of the step."""
    string: int
    step: int
    at: float
    """Request or SOC."""
    width: float
    """Relative width of the range."""

    @property
    def place(self) -> Place:
        """Key of its gain."""
        return self.kind, self.string, self.step

    def parts(self, node: _core.Node) -> tuple[_core.Node, _core.Node]:
        """Cut a node."""
        if self.kind == "full":
            return node.branch_on_full(self.string, self.step)
        cut = node.branch_on_soc if self.kind == "soc" else node.branch_on_request
        return cut(self.string, self.step, self.at)


@dataclass(frozen=True)
class NodePoint:
    """Optimum of a node's relaxation; arrays ``(n_strings, n_steps)``."""

    request_kw: Array
    soc: Array
    """Magnitudes, and SOC at the start of each step."""
    on: Array
    full: Array
    """Binaries."""

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
            if width > MIN_WIDTH and low < MIN_KW < high and self.on[place] < 1.0 - FRACTIONAL:
                cuts.append(Cut("switch", string, step, MIN_KW, width))
            elif width > MIN_WIDTH:
                cuts.append(
                    Cut("request", string, step, _inside(float(self.request_kw[place]), low, high), width)
                )
            if may_end_otherwise[place] and FRACTIONAL < self.full[place] < 1.0 - FRACTIONAL:
                cuts.append(Cut("full", string, step, np.nan, 1.0))
            low, high = float(soc_low[place]), float(soc_high[place])
            if high - low > MIN_SOC:
                width = (high - low) / max(float(self.soc[place]), LOW_SOC)
                cuts.append(Cut("soc", string, step, _inside(float(self.soc[place]), low, high), width))
        return cuts


class Branching:
    """Choice of the best cut, with the gains of earlier cuts."""

    def __init__(self, solve: Callable[[_core.Node], Solved]) -> None:
        self._solve = solve
        self._estimated: dict[Place, float] = {}
        self._gained: dict[Place, list[float]] = defaultdict(list)

    def best(
        self, node: _core.Node, bound: float, cuts: list[Cut], estimate: Callable[[_core.Node], float]
    ) -> list[Solved]:
        """Branch a node with this bound; ``estimate`` estimates the bound of a part."""
        for cut in sorted(cuts, key=lambda cut: -cut.width)[:MAX_ESTIMATES]:
            if cut.place not in self._estimated:
                bounds = [estimate(part) for part in cut.parts(node)]
                self._estimated[cut.place] = _gain_per_width(cut, bound, bounds)
        best = max(cuts, key=self._rated)
        parts = [self._solve(part) for part in best.parts(node)]
        self._gained[best.place].append(_gain_per_width(best, bound, [part.bound for part in parts]))
        return parts

    def _rated(self, cut: Cut) -> float:
        gained = self._gained[cut.place] or [self._estimated.get(cut.place, 0.0)]
        return fmean(gained) * cut.width


def _gain_per_width(cut: Cut, bound: float, bounds: list[float]) -> float:
    """Geometric mean of the gains of both parts of a cut; 0 if the node has no bound."""
    if not np.isfinite(bound):
        return 0.0
    gains = np.maximum(np.array(bounds) - bound, MIN_GAIN * abs(bound))
    return float(np.sqrt(np.prod(gains))) / cut.width


def _inside(at: float, low: float, high: float) -> float:
    margin = INNER_SHARE * (high - low)
    return float(min(max(at, low + margin), high - margin))
