"""Lower bounds of every group: what no schedule can beat, and what the convexified program proves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.split import branch_and_bound
from bess.split.branch_and_bound import Closure, Outcome
from bess.split.coefficients import Boxes, Coefficients
from bess.split.lexicographic import lexicographic
from bess.split.outcome import relative_gap
from bess.split.programs import Programs
from bess.split.search import Model, Search

Array = NDArray[np.float64]

RELAXED_ABOVE = 3e-2
"""Rigorous gap above which the one-step problems get help from a relaxation over the whole horizon."""

RELAXED_STEPS = 16
"""Longest horizon for which that is done if nothing is shed: beyond it closes a tenth to a quarter of the gap
for a third of the time."""

LARGEST_RELAXATION = 400
"""Steps of strings above which no relaxation is solved: the memory to compile it grows with their square
(1 GB at 384, 4 GB at 768), and the one-step problems say nearly as much."""


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of each group, and what the searches behind them established."""

    values: tuple[float, ...]
    closures: tuple[Closure, ...]
    nodes: int
    failed: bool


class Bounding:
    """Bounds around the incumbent of a search.

    First :meth:`rigorous`, which also finds the states that are still of interest, then :meth:`frozen`.
    """

    def __init__(self, search: Search) -> None:
        self._search = search
        self._task, self._limits = search.task, search.limits
        self._failed = False
        # For each group: states of the schedules that are no worse than the incumbent, and who can shed in
        # them.
        self._boxes: list[Boxes] = []
        self._may_shed: list[NDArray[np.bool_]] = []

    def rigorous(self) -> Bounds:
        """Bounds of the nonlinear control model: one-step problems over the states of all schedules that are
        no worse than the incumbent, then one relaxation over these states if much is missing and that can
        help."""
        model = self._task.true
        if not self._search.free_steps.size:
            return _exact(model.horizon.evaluate(self._search.request[None])[0])

        sheds = self._task.rollout(self._search.request).availability_loss_kw.any()
        long = self._search.request.shape[1] > RELAXED_STEPS

        def solve(group: int, caps: Sequence[float]) -> tuple[float, Outcome]:
            _, budget_kw = _shedding(model.costs, group, caps)
            start, boxes = model.horizon.confine(self._search.request, model.costs[group], budget_kw)
            self._boxes.append(Boxes(*boxes))
            self._may_shed.append(self._sheds_within(self._boxes[group]))
            value = self._value(model, group)
            if (long and not sheds) or relative_gap(value, start) <= RELAXED_ABOVE:
                return value, Outcome(self._closed(model, group, start), start, 0)
            return self._relaxed(model, group, caps, self._boxes[group], start, node_limit=1)

        return self._bounds(solve)

    def frozen(self) -> Bounds:
        """Bounds of the program with coefficients frozen along the incumbent, over the states that
        :meth:`rigorous` left; the tree may still improve the incumbent."""
        model = self._task.search
        if not self._search.free_steps.size:
            return _exact(model.horizon.evaluate(self._search.request[None])[0])
        before = self._search.request
        trajectory = self._trajectory()

        def solve(group: int, caps: Sequence[float]) -> tuple[float, Outcome]:
            shed_cost, budget_kw = _shedding(model.costs, group, caps)
            most_kw = self._most_shed_kw(group)
            phi, slope, request = model.horizon.step_bounds(
                *trajectory.at_starts, model.costs[group], np.minimum(most_kw, budget_kw)
            )
            start = least_cost(phi, slope, shed_cost, most_kw, budget_kw)
            request = self._search.usable(np.abs(request))
            self._search.offer(request[None])
            if not self._task.rollout(request).availability_loss_kw.any():
                # Nothing is shed where every step is at its own optimum: so it is that of all steps together.
                return self._value(model, group), Outcome(self._closed(model, group, start), start, 0)
            return self._relaxed(model, group, caps, trajectory, start, self._limits.nodes)

        bounds = self._bounds(solve)
        if self._search.request is not before:
            self._search.improve(self._search.request[None])
        return bounds

    def _bounds(self, solve: Callable[[int, Sequence[float]], tuple[float, Outcome]]) -> Bounds:
        self._failed = False
        outcomes = lexicographic(solve, *self._task.tolerances)
        return Bounds(
            tuple(outcome.bound for outcome in outcomes),
            tuple(outcome.closure for outcome in outcomes),
            sum(outcome.nodes for outcome in outcomes),
            self._failed,
        )

    def _relaxed(
        self,
        model: Model,
        group: int,
        caps: Sequence[float],
        states: Boxes,
        start: float,
        node_limit: int,
    ) -> tuple[float, Outcome]:
        """Branch and bound on the relaxation with the coefficients of these states, unless the gap is closed
        already."""
        value = self._value(model, group)
        closure = self._closed(model, group, start)
        if closure is Closure.GAP:
            return value, Outcome(closure, start, 0)
        if self._search.late():
            return value, Outcome(Closure.TIME_LIMIT, start, 0)
        if self._search.request.size > LARGEST_RELAXATION:
            return value, Outcome(Closure.NODE_LIMIT, start, 0)
        most_kw = self._most_shed_kw(group)
        programs = Programs(
            self._task,
            self._boxes[group],
            self._may_shed[group],
            Coefficients.over(model.horizon, states, self._trajectory()),
            model.costs,
            lambda costs: model.horizon.step_bounds(*states.at_starts, costs, most_kw)[:2],
        )
        stage = programs.stage(group, caps, lambda: self._value(model, group), self._search.propose)
        outcome = branch_and_bound.search(
            stage,
            *stage.root(),
            gap=self._limits.gap,
            abs_gap=self._task.tolerances[0][group],
            node_limit=node_limit,
            deadline=self._limits.deadline,
            start_bound=start,
        )
        self._failed = self._failed or stage.failures == outcome.nodes
        return self._value(model, group), outcome

    def _value(self, model: Model, group: int) -> float:
        """Objective of the incumbent."""
        return float(model.horizon.evaluate(self._search.request[None])[0, group])

    def _closed(self, model: Model, group: int, bound: float) -> Closure:
        """What a bound says that holds for a program which has no other solution than its own."""
        value = self._value(model, group)
        within = value - bound <= self._task.tolerances[0][group]
        return Closure.GAP if within or relative_gap(value, bound) <= self._limits.gap else Closure.TREE

    def _sheds_within(self, boxes: Boxes) -> NDArray[np.bool_]:
        coefficients = Coefficients.over(self._task.true.horizon, boxes, boxes)
        return self._task.constants.may_shed(self._task.inputs, boxes, coefficients)

    def _most_shed_kw(self, group: int) -> Array:
        """What can be shed in each step ``(n_steps,)``."""
        sheds = self._may_shed[group].any(axis=0)
        return np.where(sheds, np.abs(self._task.inputs.demand_kw), 0.0)

    def _trajectory(self) -> Boxes:
        """States along the incumbent, as boxes that are points."""
        state, roll = self._task.inputs.state, self._task.rollout(self._search.request)
        soc = np.concatenate([state.soc[:, None], roll.soc], axis=1)
        temperature = np.concatenate([state.temperature_c[:, None], roll.temperature_c], axis=1)
        return Boxes(soc, soc, temperature, temperature)


def _exact(objectives: Array) -> Bounds:
    """Bounds of the only schedule there is."""
    values = tuple(float(x) for x in objectives)
    return Bounds(values, (Closure.GAP,) * len(values), 0, failed=False)


def least_cost(phi: Array, shed_slope: Array, shed_cost: float, most_kw: Array, budget_kw: float) -> float:
    """Least sum over the steps of ``max(phi - shed_slope a, 0) + shed_cost a``, with ``a <= most_kw`` in each
    step and ``sum a <= budget_kw``: what step cuts alone say about a horizon.

    The steepest step is shed first, each until its cut is used up.
    """
    order = np.argsort(-shed_slope, kind="stable")
    phi, saved = phi[order], np.maximum(shed_slope[order] - shed_cost, 0.0)
    useful_kw = np.minimum(most_kw[order], phi / np.where(saved > 0.0, shed_slope[order], np.inf))
    left_kw = np.maximum(budget_kw - np.cumsum(useful_kw) + useful_kw, 0.0)
    return float((phi - saved * np.minimum(useful_kw, left_kw)).sum())


def _shedding(costs: Array, group: int, caps: Sequence[float]) -> tuple[float, float]:
    """Smallest cost of a shed kW in a group, and the most that the groups before it let be shed [kW]."""
    cheapest = costs[:, :, 0].min(axis=1)
    allowed = [cap / cost for cap, cost in zip(caps, cheapest, strict=False) if cost > 0.0]
    return float(cheapest[group]), min(allowed, default=np.inf)
