"""The search for a good split: incumbents come from the control model alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.split.coefficients import PlantConstants
from bess.split.exchanges import exchanges, swapped
from bess.split.incumbent import Incumbent, repaired
from bess.split.inputs import HorizonInputs
from bess.split.rollout import Rollout

Array = NDArray[np.float64]

SAMPLED_STEPS, SAMPLED_STARTS, SEED = 50_000, 12, 1
"""Steps of strings rolled out for a sample of schedules, and how many of these become starts."""
LEAST_SAMPLES = 1500
EXCHANGES = 12
"""Most exchanges tried before the search looks whether they gain anything."""
MOST_SWAPS = 64
"""Most swaps of strings that are tried."""
EFFORT = 90
"""Roll-outs after which no exchange is tried any more, in those of one descent."""
WORTHWHILE = 1e-6
"""Gain of a round of exchanges that asks for another one, relative."""
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


class Search:
    """The search for one split."""

    def __init__(self, task: Task, limits: Limits) -> None:
        self.task, self.limits = task, limits
        inputs = task.inputs
        self.sign = np.where(inputs.demand_kw < 0.0, -1.0, 1.0)
        self.free_steps = np.flatnonzero(_is_free(np.abs(inputs.demand_kw), inputs.limit_kw))
        proportional = self.usable(inputs.limit_kw)
        objectives = task.search.horizon.evaluate(proportional[None])[0]
        self.rollouts = 0
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
        """Local search on the control model from a greedy pass and, where the plant is full or empty or soon
        is, from other starts.

        Steps that share a scarce SOC make local optima. A closed loop carries a good schedule along from
        step to step; a call without that memory looks for one among samples and exchanges.
        """
        if not self.free_steps.size:
            return
        greedy, _ = self.task.search.horizon.greedy()
        self.offer(greedy[None])
        if warm_start is not None:
            self.offer(self.usable(np.maximum(warm_start * self.sign, 0.0))[None])
        self.improve(self.request[None])
        self._swap()
        roll = self.task.rollout(self.request)
        if roll.availability_loss_kw.any():
            self.improve(self.usable(self.task.inputs.limit_kw)[None])
        if warm_start is not None or self.free_steps.size < 2 or not self._is_scarce(roll):
            return
        rng = np.random.default_rng(SEED)
        self.improve(self._best_of_sample(rng))
        self._exchange(rng)

    def _swap(self) -> None:
        """Let strings that are next to each other in what they do change places from some step on."""
        order = np.argsort(-np.abs(self.request).sum(axis=1), kind="stable")
        swaps = swapped(np.abs(self.request), order, MOST_SWAPS)
        before = self.request
        self.offer(self.usable(swaps))
        if self.request is not before:
            self.improve(self.request[None])

    def _is_scarce(self, roll: Rollout) -> bool:
        """Whether something is shed, or one more step like the largest of the horizon takes all strings
        together to an end of their windows."""
        constants = self.task.constants
        soc = np.concatenate([self.task.inputs.state.soc[:, None], roll.soc], axis=1)
        room = np.minimum(soc - constants.soc_min[:, None], constants.soc_max[:, None] - soc)
        moved = np.abs(np.diff(soc)).sum(axis=0)
        return bool(roll.availability_loss_kw.any() or room.sum(axis=0).min() < moved.max())

    def _random(self, rng: np.random.Generator, n: int) -> Array:
        """Schedules in which each step is shared at random, or given to one string; in every other of them,
        all steps alike."""
        shape = (n, *self.request.shape)
        sharpness = rng.choice(SHARPNESS, size=(n, 1, shape[-1]))
        sharpness[::2] = sharpness[::2, :, :1]
        share = rng.uniform(size=shape)
        share = (share / share.max(axis=1, keepdims=True)) ** sharpness
        return self.usable(share * self.task.inputs.limit_kw)

    def _best_of_sample(self, rng: np.random.Generator) -> Array:
        requests = self._random(rng, max(LEAST_SAMPLES, SAMPLED_STEPS // self.request.size))
        objectives = self.task.search.horizon.evaluate(requests)
        return requests[np.lexsort(np.round(objectives, 4).T[::-1])[:SAMPLED_STARTS]]

    def improve(self, starts: Array) -> None:
        """Local search on the control model from each of ``(n, n_strings, n_steps)``, group after group; a
        start that cannot get under the ceiling of one is given up."""
        for start in starts:
            request = start
            for group in range(self.incumbent.objectives.size):
                request, objectives = self._descend(request, group)
                if objectives[group] > self.incumbent.ceilings[group]:
                    break

    def _descend(self, start: Array, group: int) -> tuple[Array, Array]:
        """Minimise one group under the ceilings of those before it."""
        ceilings, most = self.incumbent.ceilings, self.limits.rollouts
        request, objectives, used = self.task.search.horizon.descend(start[None], group, ceilings, most)
        self.rollouts += used
        self.incumbent.offer(request, objectives)
        return request, objectives

    def _exchange(self, rng: np.random.Generator) -> None:
        """Exchanges between steps, for the sake of one group after the other; once more from the first group
        that they improve."""
        group = 0
        while group < self.incumbent.objectives.size:
            before = self.incumbent.standing
            for start in self._exchanged(rng):
                if self.late() or self.rollouts > EFFORT * self.limits.rollouts:
                    return
                self._descend(start, group)
            gains = np.flatnonzero(self.incumbent.standing < before * (1.0 - WORTHWHILE))
            group = int(gains[0]) if gains.size else group + 1

    def _exchanged(self, rng: np.random.Generator) -> Array:
        """Exchanges within the incumbent, all offered."""
        inputs, delivered = self.task.inputs, self.task.rollout(self.request).delivered_kw
        demand = np.abs(inputs.demand_kw)
        given = np.abs(self.request), np.abs(delivered), demand, inputs.limit_kw
        requests = exchanges(*given, rng, EXCHANGES) * self.sign
        self.offer(requests)
        return requests

    def propose(self, request_pu: Array, on: Array) -> None:
        """Offer the point of a node, and the same with only those strings that it rather runs."""
        wanted = np.maximum(request_pu, 0.0) * self.task.constants.nominal_kw[:, None]
        self.offer(np.stack([self.usable(wanted), self.usable(np.where(on > 0.5, wanted, 0.0))]))

    def usable(self, magnitude_kw: Array) -> Array:
        """Requests in these proportions that meet the demand within the limits, signed."""
        inputs = self.task.inputs
        return repaired(magnitude_kw, np.abs(inputs.demand_kw), inputs.limit_kw) * self.sign

    def late(self) -> bool:
        """Whether the time limit has struck."""
        return self.limits.deadline is not None and time.perf_counter() >= self.limits.deadline


def _is_free(demand_kw: Array, limit_kw: Array) -> NDArray[np.bool_]:
    """Steps in which there is something to decide: more than one string can run, and not all have to."""
    several = np.count_nonzero(limit_kw, axis=0) > 1
    free: NDArray[np.bool_] = (
        several & (demand_kw > 0.0) & (demand_kw < limit_kw.sum(axis=0) * (1.0 - ROUNDING))
    )
    return free
