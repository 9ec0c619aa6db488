"""Nodes, bounds and branching of the relaxation of one group of a split problem.

The core first tightens the bounds of a node: boxes of states, ranges of requests, and on/off ranges of the
strings in each step. The conic program with coefficients over these ranges then bounds the node.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.arrays import Array
from bess.control.problem import SplitProblem
from bess.control.split.relaxation import conic
from bess.control.split.relaxation.branching import MIN_SOC, Branching, Cut, NodePoint
from bess.control.split.relaxation.data import THETA_UNIT_K, THETA_ZERO_C, PlantConstants, costs
from bess.control.split.relaxation.equations import BINARIES, LOSSES, compiled
from bess.control.split.tree import Solved

MAX_CUT_SLOPE = 1e4
"""Maximum coefficient of the availability loss in a step cut, per unit."""

IN_KW = np.array([0.0, 0.0, 1.0, 1.0])
"""Costs of a cut that counts inverter and battery losses in kW."""

SAME_KW, SAME_SOC = 1e-4, 1e-6
"""Tolerance within which a point of the relaxation counts as a schedule of the control model."""

Propose = Callable[[Array, Array], None]
"""Receives the requests (relative to nominal power) and the strings that are on in a node's optimum."""

Instance = tuple[conic.ConicData, NDArray[np.bool_], Array]
"""A program, its fixed variables and their values."""


class RelaxedGroup:
    """Relaxation of one group, with earlier groups at most at their ceilings.

    Parameters
    ----------
    problem, control, constants
        The problem, its control model, and the constants of its plant.
    cost : ndarray, shape (n_groups, n_strings, 4)
        Costs of the losses [1/kW].
    ceilings : sequence of float
        Cost limits of all earlier groups; their number is the index of this group.
    cutoff : float
        Cost limit of this group: schedules that do not improve the incumbent by the gap are excluded.
    near : _core.StateBoxes
        States of the incumbent (points); planes are tight near them.
    frozen
        Whether coefficients are evaluated at these states, instead of over the states of each node.
    propose
        Function that receives the optimum of every node.
    """

    def __init__(
        self,
        problem: SplitProblem,
        control: _core.ControlHorizon,
        constants: PlantConstants,
        cost: Array,
        ceilings: Sequence[float],
        cutoff: float,
        near: _core.StateBoxes,
        propose: Propose,
        *,
        frozen: bool = False,
    ) -> None:
        group, n_before = len(ceilings), cost.shape[0] - 1
        self._problem, self._control, self._constants = problem, control, constants.at(problem.state)
        self._cutoff, self._near, self._propose, self._frozen = cutoff, near, propose, frozen
        self._cost = cost[group]
        per_unit = cost * constants.scale_kw
        units = per_unit.max(axis=(1, 2))
        units[units == 0.0] = 1.0  # a priority whose weights are all zero
        self.unit = float(units[group])
        # Step cuts of a group without losses are in kW, because losses use up stored charge.
        own = per_unit[group] if per_unit[group][:, 1:].any() else constants.scale_kw * IN_KW
        self._cut_unit = float(own.max())
        self._cut_cost = own / constants.scale_kw
        static: dict[str, Array | float] = {
            **self._constants.physics(problem),
            # Exchanging two identical strings gives an equally good schedule in the boxes; frozen
            # coefficients belong to one string each.
            "ordered": np.append(self._constants.same & _equal_rows(problem.limit_kw) & (not frozen), False),
            **costs("cost", per_unit[group] / units[group]),
            **{f"cut_{name}": own[:, i] / self._cut_unit for i, name in enumerate(LOSSES) if name != "a"},
        }
        shed_budgets_kw = [np.inf]
        for g in range(n_before):
            active = g < group
            weight = per_unit[g] / units[g] if active else np.zeros_like(per_unit[g])
            static |= costs(f"cap{g}", weight)
            static[f"cap{g}"] = ceilings[g] / units[g] if active else 1.0
            if active and cost[g, :, 0].min() > 0.0:
                shed_budgets_kw.append(ceilings[g] / cost[g, :, 0].min())
        self._shed_budget_kw = min(shed_budgets_kw)
        self.program = compiled(*problem.limit_kw.shape, n_before)
        self._theta = self.program.parameters(static)
        self._units_kw = np.stack([constants.inverter_kw, constants.battery_kw], axis=1)
        self._columns = {
            name: np.arange(s.start, s.stop).reshape(self.program.shapes[name], order="F")
            for name, s in self.program.slices.items()
        }
        self._fixed = np.zeros(self.program.n_columns, dtype=bool)
        self._values = np.zeros(self.program.n_columns)
        state = problem.state
        theta = (state.temperature_c - THETA_ZERO_C) / THETA_UNIT_K
        for name, value in (("soc", state.soc), ("theta", theta), ("e", np.zeros_like(theta))):
            self._fixed[self._columns[name][:, 0]] = True
            self._values[self._columns[name][:, 0]] = value
        self.failures = 0
        self.nodes = 0
        self._branching = Branching(self.solve)

    def solve(self, node: _core.Node) -> Solved:
        """Tighten the bounds of a node and solve it; its bound has the unit of the group's objective.

        The node excludes schedules that cost more than the cutoff, so no bound exceeds it.
        """
        cutoff, budget_kw = self._cutoff, self._shed_budget_kw
        if self._cost[:, 0].min() > 0.0:
            budget_kw = min(budget_kw, cutoff / self._cost[:, 0].min())
        program = self._program(node, budget_kw)
        if program is None:
            return Solved(cutoff)
        tightened, cells, instance = program
        answer = conic.solve(*instance)
        self.nodes += 1
        self.failures += answer.bound == -np.inf
        bound = min(answer.bound * self.unit, cutoff)
        if answer.x is not None:
            p, a, d, on = (self.program.value(answer.x, name) for name in ("p", "a", "d", "on"))
            self._propose(p + a + d, on)
        cuts = self._cuts(tightened, cells, answer.x) if bound < cutoff else []
        if not cuts:
            return Solved(bound)

        def estimate(part: _core.Node) -> float:
            """Bound of a part at the shadow prices of this node, to first order."""
            program = self._program(part, budget_kw)
            if program is None:
                return cutoff
            gain = conic.lagrangian(*program[2], answer) - conic.lagrangian(*instance, answer)
            return min(bound + gain * self.unit, cutoff)

        return Solved(bound, lambda: self._branching.best(tightened, bound, cuts, estimate))

    def _program(
        self, node: _core.Node, budget_kw: float
    ) -> tuple[_core.Node, dict[str, Array], Instance] | None:
        """Tightened node, its coefficients and its program; None if the node is empty."""
        tightened = self._control.tighten_node(node, budget_kw)
        if tightened is None:
            return None
        cells, instance = self.instance(tightened, budget_kw)
        return tightened, cells, instance

    def instance(self, node: _core.Node, budget_kw: float) -> tuple[dict[str, Array], Instance]:
        """Return the coefficients over a tightened node by name, each ``(n_strings, n_steps)``, and its
        program with a limit on the total availability loss, its fixed variables and their values."""
        cells = self._control.relaxed(node, self._near, self._frozen, self._units_kw)
        theta = self._theta.copy()
        for name in cells.keys() & self.program.places.keys():
            theta[self.program.places[name]] = cells[name]
        shed_kw = cells["a_hi"] * self._constants.nominal_kw[:, None]
        self._cut(theta, node, np.minimum(shed_kw.sum(axis=0), budget_kw))
        return cells, (self.program.load(theta), *self._settled(cells))

    def _settled(self, cells: dict[str, Array]) -> tuple[NDArray[np.bool_], Array]:
        """Variables fixed by the ranges of a node, and their values."""
        fixed, values = self._fixed.copy(), self._values.copy()

        def flag(name: str) -> NDArray[np.bool_]:
            return np.asarray(cells[name] > 0.0)

        runs, sheds = flag("may_run"), flag("may_shed")
        settled = {
            "on": ~runs | flag("must_run"),
            "full": ~sheds,
            "low": ~flag("may_be_low") | flag("must_be_low"),
        }
        values[self._columns["on"]] = flag("must_run")
        values[self._columns["low"]] = flag("must_be_low")
        for name in BINARIES:
            fixed[self._columns[name][settled[name]]] = True
        for name in ("p", "w", "h", "z", "P"):
            fixed[self._columns[name][~runs]] = True
        fixed[self._columns["a"][~sheds & (cells["a_off"] == 0.0)]] = True
        fixed[self._columns["d"][cells["derating_hi"] <= 0.0]] = True
        return fixed, values

    def _cut(self, theta: Array, node: _core.Node, shed_kw: Array) -> None:
        """Step cuts of a node with a limit on the availability loss of each step, per unit; if frozen, at the
        points of the schedule."""
        nominal = self._constants.nominal_kw
        if self._frozen:
            cuts = self._control.step_bounds(self._near, self._cut_cost, shed_kw)
        else:
            cuts = self._control.step_bounds_of(node, self._cut_cost, shed_kw)
        # The slope grows without limit as the demand vanishes; such a cut is redundant and badly scaled.
        useful = cuts.shed_slope < MAX_CUT_SLOPE * self._cut_unit / nominal.max()
        places = self.program.places
        slope = np.where(useful, cuts.shed_slope, 0.0) / self._cut_unit
        theta[places["cut_a"]] = slope * nominal[:, None]
        theta[places["cut_0"]] = np.where(useful, cuts.phi, 0.0) / self._cut_unit

    def _cuts(self, node: _core.Node, cells: dict[str, Array], x: Array | None) -> list[Cut]:
        """Cuts of a node; none if its point is a schedule of the control model."""
        point = NodePoint.middle(node) if x is None else self._point(node, x)
        if point is None:
            return []
        return point.cuts(node, self._constants.nominal_kw, cells["full_slack"] > MIN_SOC)

    def _point(self, node: _core.Node, x: Array) -> NodePoint | None:
        """Optimum of a relaxation within its node; None if it is a schedule of the control model."""
        p, a, d, w, h, along, theta, on, full = (
            self.program.value(x, name) for name in ("p", "a", "d", "w", "h", "soc", "theta", "on", "full")
        )
        nominal, boxes = self._constants.nominal_kw[:, None], node.boxes
        request_kw = np.clip((p + a + d) * nominal, node.request_low_kw, node.request_high_kw)
        soc = np.clip(along, boxes.soc_low, boxes.soc_high)
        celsius = theta * THETA_UNIT_K + THETA_ZERO_C
        celsius = np.clip(celsius, boxes.temperature_low_c, boxes.temperature_high_c)
        at = _core.StateBoxes(soc, soc, celsius, celsius)
        flows = self._control.flows_from(at, np.maximum(request_kw, 0.0))
        missed_kw = np.abs(np.abs(flows.delivered_kw) - p * nominal)
        missed_kw += np.abs(flows.inverter_loss_kw - w * self._units_kw[:, :1])
        missed_kw += np.abs(flows.battery_loss_kw - h * self._units_kw[:, 1:])
        if missed_kw.max() <= SAME_KW and np.abs(flows.soc - along[:, 1:]).max() <= SAME_SOC:
            return None
        return NodePoint(request_kw, soc[:, :-1], on, full)


def _equal_rows(values: Array) -> NDArray[np.bool_]:
    return np.asarray(np.all(np.diff(values, axis=0) == 0.0, axis=1))
