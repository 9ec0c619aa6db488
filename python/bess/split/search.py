"""One call of the power split: incumbents from the control model, lower bounds from the relaxation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.split import branch_and_bound
from bess.split.branch_and_bound import Closure, Outcome
from bess.split.coefficients import Boxes, Coefficients, PlantConstants
from bess.split.incumbent import is_better, repaired
from bess.split.inputs import HorizonInputs
from bess.split.lexicographic import lexicographic
from bess.split.outcome import relative_gap
from bess.split.programs import Programs
from bess.split.rollout import Rollout

Array = NDArray[np.float64]

FREEZINGS = 2
"""Times the coefficients are frozen along an incumbent that the tree then improves."""



@dataclass(frozen=True)
class Limits:
    """When a search stops: relative gap, nodes of a stage, roll-outs, and ``time.perf_counter()``."""

    gap: float
    nodes: int
    rollouts: int
    deadline: float | None


@dataclass(frozen=True)
class Model:
    """Control model over the horizon, and costs of the losses ``(n_groups, n_strings, 4)`` [1/kW]."""

    horizon: _core.ControlHorizon
    costs: Array


@dataclass(frozen=True)
class Task:
    """One split problem: plant, measured state and demand, with what its objectives cost.

    Attributes
    ----------
    constants : PlantConstants
    inputs : HorizonInputs
    search, true : Model
        Costs of the first carry tie-break weights.
    tolerances : tuple of ndarray, shape (n_groups,)
        Absolute and relative.
    alike : ndarray of bool, shape (n_strings - 1,)
        Whether string ``m + 1`` has the parameters of string ``m``.
    rollout : callable
        What requests ``(n_strings, n_steps)`` [kW] do.
    """

    constants: PlantConstants
    inputs: HorizonInputs
    search: Model
    true: Model
    tolerances: tuple[Array, Array]
    alike: NDArray[np.bool_]
    rollout: Callable[[Array], Rollout]


@dataclass(frozen=True)
class Bounds:
    """Lower bounds of each group, and what the searches behind them established."""

    values: tuple[float, ...]
    closures: tuple[Closure, ...]
    nodes: int
    failed: bool


class Search:
    """The search for one split."""

    def __init__(self, task: Task, limits: Limits) -> None:
        self.task, self.limits = task, limits
        inputs = task.inputs
        self.sign = np.where(inputs.demand_kw < 0.0, -1.0, 1.0)
        self.boxes = Boxes(*task.search.horizon.reachable())
        self.may_shed = task.constants.may_shed(
            inputs, self.boxes, Coefficients.over(task.search.horizon, self.boxes)
        )
        self.request = self._usable(inputs.limit_kw)
        self.objectives = task.search.horizon.evaluate(self.request[None])[0]

    def offer(self, requests: Array) -> None:
        """Roll requests ``(batch, n_strings, n_steps)`` out and keep the best."""
        for request, objectives in zip(requests, self.task.search.horizon.evaluate(requests), strict=True):
            self._keep_better(request, objectives)

    def find_incumbent(self, warm_start: Array | None) -> None:
        """Greedy pass and warm start, then local search on the control model from the better of both."""
        self._keep_better(*self.task.search.horizon.greedy())
        if warm_start is not None:
            self.offer(self._usable(np.maximum(warm_start * self.sign, 0.0))[None])
        self._improve()

    def _improve(self) -> None:
        request, objectives, _ = self.task.search.horizon.search(self.request[None], self.limits.rollouts)
        self._keep_better(request, objectives)

    def _keep_better(self, request: Array, objectives: Array) -> None:
        if is_better(objectives, self.objectives, *self.task.tolerances):
            self.request, self.objectives = request, objectives

    def rigorous_bounds(self) -> Bounds:
        """Bounds of the nonlinear control model: one-step optima over the reachable states, and one relaxation."""
        return self._bounds(self.task.true, self.boxes, 1, frozen=False)

    def frozen_bounds(self) -> Bounds:
        """Bounds of the program with coefficients frozen along the incumbent.

        Where the tree finds a better incumbent, local search goes on from there and the bounds are taken anew.
        """
        nodes = 0
        for _ in range(FREEZINGS):
            incumbent = self.request
            bounds = self._bounds(self.task.search, self._trajectory(), self.limits.nodes, frozen=True)
            nodes += bounds.nodes
            if self.request is incumbent:
                break
            self._improve()
        return replace(bounds, nodes=nodes)

    def _trajectory(self) -> Boxes:
        """States along the incumbent, as boxes that are points."""
        state, roll = self.task.inputs.state, self.task.rollout(self.request)
        soc = np.concatenate([state.soc[:, None], roll.soc], axis=1)
        temperature = np.concatenate([state.temperature_c[:, None], roll.temperature_c], axis=1)
        return Boxes(soc, soc, temperature, temperature)

    def _propose(self, request_pu: Array, on: Array) -> None:
        """Offer the point of a node, and the same with only those strings that it rather runs."""
        wanted = np.maximum(request_pu, 0.0) * self.task.constants.nominal_kw[:, None]
        self.offer(np.stack([self._usable(wanted), self._usable(np.where(on > 0.5, wanted, 0.0))]))

    def _usable(self, magnitude_kw: Array) -> Array:
        """Requests in these proportions that meet the demand within the limits, signed."""
        inputs = self.task.inputs
        return repaired(magnitude_kw, np.abs(inputs.demand_kw), inputs.limit_kw) * self.sign

    def _late(self) -> bool:
        return self.limits.deadline is not None and time.perf_counter() >= self.limits.deadline

    def _bounds(self, model: Model, states: Boxes, node_limit: int, *, frozen: bool) -> Bounds:
        """Bounds of every group, from the one-step optima where they suffice, else from the relaxation."""
        phi, shed_slope = model.horizon.step_bounds(*states.at_starts)
        sheds = self.may_shed.any(axis=0)
        from_steps = np.where(sheds, 0.0, phi).sum(axis=1)
        programs: Programs | None = None
        outcomes = []
        failed = False

        def solve(group: int, caps: Sequence[float]) -> tuple[float, Outcome]:
            nonlocal programs, failed

            def incumbent() -> float:
                return float(model.horizon.evaluate(self.request[None])[0, group])

            value, start = incumbent(), float(from_steps[group])
            if relative_gap(value, start) <= self.limits.gap:
                return value, Outcome(Closure.GAP, start, 0)
            if frozen and not sheds.any():
                # Frozen coefficients and nothing to shed: the steps are independent and this is their optimum.
                return value, Outcome(Closure.TREE, start, 0)
            if self._late():
                return value, Outcome(Closure.TIME_LIMIT, start, 0)
            if programs is None:
                coefficients = Coefficients.over(model.horizon, states)
                programs = Programs(
                    self.task, self.boxes, self.may_shed, coefficients, model.costs, phi[-1], shed_slope[-1]
                )
            stage = programs.stage(group, caps, incumbent, self._propose)
            outcome = branch_and_bound.search(
                stage,
                *stage.root(),
                gap=self.limits.gap,
                node_limit=node_limit,
                deadline=self.limits.deadline,
                start_bound=start,
            )
            failed = failed or stage.failures == outcome.nodes
            return incumbent(), outcome

        outcomes = lexicographic(solve, *self.task.tolerances)
        return Bounds(
            tuple(outcome.bound for outcome in outcomes),
            tuple(outcome.closure for outcome in outcomes),
            sum(outcome.nodes for outcome in outcomes),
            failed,
        )
