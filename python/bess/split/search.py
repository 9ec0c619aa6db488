"""One call of the power split: incumbents from the control model, lower bounds from the relaxation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.split import branch_and_bound
from bess.split.branch_and_bound import Closure, Outcome
from bess.split.coefficients import Boxes, Coefficients, PlantConstants
from bess.split.incumbent import Incumbent, repaired
from bess.split.inputs import HorizonInputs
from bess.split.lexicographic import lexicographic
from bess.split.outcome import relative_gap
from bess.split.programs import Programs
from bess.split.rollout import Rollout

Array = NDArray[np.float64]

SAMPLES, SAMPLED_STARTS, SEED = 1500, 8, 1
KICKS, KICK_ROUNDS, IDLE_ROUNDS = 9, 6, 2
ROUNDING = 1e-12
"""A demand this close to the sum of the limits (relative) asks every string for its limit."""

SHARPNESS = (0.3, 1.0, np.inf)
"""Exponents of uniform shares: nearly equal shares, any, all to one string."""


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
        self.free_steps = np.flatnonzero(_is_free(np.abs(inputs.demand_kw), inputs.limit_kw))
        proportional = self._usable(inputs.limit_kw)
        objectives = task.search.horizon.evaluate(proportional[None])[0]
        self.incumbent = Incumbent(proportional, objectives, *task.tolerances)

    @property
    def request(self) -> Array:
        """Best requests known [kW, signed]."""
        return self.incumbent.request

    def offer(self, requests: Array) -> None:
        """Roll requests ``(batch, n_strings, n_steps)`` out and keep the best."""
        for request, objectives in zip(requests, self.task.search.horizon.evaluate(requests), strict=True):
            self.incumbent.offer(request, objectives)

    def find_incumbent(self, warm_start: Array | None) -> None:
        """Local search on the control model from a greedy pass and, where power may be shed, from other
        starts.

        Steps that share a scarce SOC make local optima. A closed loop carries a good schedule along from
        step to step; a call without that memory looks for one among samples.
        """
        if not self.free_steps.size:
            return
        greedy, _ = self.task.search.horizon.greedy()
        self.offer(greedy[None])
        if warm_start is not None:
            self.offer(self._usable(np.maximum(warm_start * self.sign, 0.0))[None])
        self._improve(self.request[None])
        if not self._trajectory_sheds():
            return
        self._improve(self._usable(self.task.inputs.limit_kw)[None])
        if self.free_steps.size < 2 or warm_start is not None:
            return
        rng = np.random.default_rng(SEED)
        self._improve(self._best_of_sample(rng))
        idle = 0
        for _ in range(KICK_ROUNDS):
            if self._late() or idle == IDLE_ROUNDS:
                break
            before = self.request
            self._improve(self._kicked(rng))
            idle = idle + 1 if self.request is before else 0

    def _trajectory_sheds(self) -> bool:
        return bool(self.may_shed.any() and self.task.rollout(self.request).availability_loss_kw.any())

    def _random(self, rng: np.random.Generator, n: int) -> Array:
        """Schedules in which each step is shared at random, or given to one string; in every other of them,
        all steps alike."""
        shape = (n, *self.request.shape)
        sharpness = rng.choice(SHARPNESS, size=(n, 1, shape[-1]))
        sharpness[::2] = sharpness[::2, :, :1]
        share = rng.uniform(size=shape)
        share = (share / share.max(axis=1, keepdims=True)) ** sharpness
        return self._usable(share * self.task.inputs.limit_kw)

    def _best_of_sample(self, rng: np.random.Generator) -> Array:
        requests = self._random(rng, SAMPLES)
        objectives = self.task.search.horizon.evaluate(requests)
        return requests[np.lexsort(np.round(objectives, 4).T[::-1])[:SAMPLED_STARTS]]

    def _kicked(self, rng: np.random.Generator) -> Array:
        """The incumbent with one to three of its free steps shared anew."""
        anew = np.zeros((KICKS, self.request.shape[1]), dtype=bool)
        for kick in range(KICKS):
            anew[kick, rng.permutation(self.free_steps)[: 1 + kick % 3]] = True
        return np.where(anew[:, None, :], self._random(rng, KICKS), self.request)

    def _improve(self, starts: Array) -> None:
        for start in starts:
            request, objectives, _ = self.task.search.horizon.search(start[None], self.limits.rollouts)
            self.incumbent.offer(request, objectives)

    def rigorous_bounds(self) -> Bounds:
        """Bounds of the nonlinear control model: one-step optima over the reachable states, and one
        relaxation."""
        return self._bounds(self.task.true, self.boxes, 1, frozen=False)

    def frozen_bounds(self) -> Bounds:
        """Bounds of the program with coefficients frozen along the incumbent; the tree may still improve
        that."""
        before = self.request
        bounds = self._bounds(self.task.search, self._trajectory(), self.limits.nodes, frozen=True)
        if self.request is not before:
            self._improve(self.request[None])
        return bounds

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
        if not self.free_steps.size:
            return _exact(model.horizon.evaluate(self.request[None])[0])
        phi, shed_slope = model.horizon.step_bounds(*states.at_starts)
        sheds = self.may_shed.any(axis=0)
        most_kw = np.where(sheds, np.abs(self.task.inputs.demand_kw), 0.0)
        abs_tol, _ = self.task.tolerances
        programs: Programs | None = None
        outcomes = []
        failed = False

        def solve(group: int, caps: Sequence[float]) -> tuple[float, Outcome]:
            nonlocal programs, failed

            def incumbent() -> float:
                return float(model.horizon.evaluate(self.request[None])[0, group])

            value = incumbent()
            shed_cost, budget_kw = _shedding(model.costs, group, caps)
            start = least_cost(phi[group], shed_slope[group], shed_cost, most_kw, budget_kw)
            if relative_gap(value, start) <= self.limits.gap or value - start <= abs_tol[group]:
                return value, Outcome(Closure.GAP, start, 0)
            if frozen and not sheds.any():
                # Frozen coefficients and nothing to shed: the steps are independent and this is their
                # optimum.
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
                abs_gap=abs_tol[group],
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


def _is_free(demand_kw: Array, limit_kw: Array) -> NDArray[np.bool_]:
    """Steps in which there is something to decide: more than one string can run, and not all have to."""
    several = np.count_nonzero(limit_kw, axis=0) > 1
    free: NDArray[np.bool_] = (
        several & (demand_kw > 0.0) & (demand_kw < limit_kw.sum(axis=0) * (1.0 - ROUNDING))
    )
    return free


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
