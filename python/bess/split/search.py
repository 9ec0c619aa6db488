"""The search for a good split: incumbents come from the control model alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.split.coefficients import PlantConstants
from bess.split.incumbent import Incumbent, repaired
from bess.split.inputs import HorizonInputs
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


class Search:
    """The search for one split."""

    def __init__(self, task: Task, limits: Limits) -> None:
        self.task, self.limits = task, limits
        inputs = task.inputs
        self.sign = np.where(inputs.demand_kw < 0.0, -1.0, 1.0)
        self.free_steps = np.flatnonzero(_is_free(np.abs(inputs.demand_kw), inputs.limit_kw))
        proportional = self.usable(inputs.limit_kw)
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
            self.offer(self.usable(np.maximum(warm_start * self.sign, 0.0))[None])
        self.improve(self.request[None])
        if not self._trajectory_sheds():
            return
        self.improve(self.usable(self.task.inputs.limit_kw)[None])
        if self.free_steps.size < 2 or warm_start is not None:
            return
        rng = np.random.default_rng(SEED)
        self.improve(self._best_of_sample(rng))
        idle = 0
        for _ in range(KICK_ROUNDS):
            if self.late() or idle == IDLE_ROUNDS:
                break
            before = self.request
            self.improve(self._kicked(rng))
            idle = idle + 1 if self.request is before else 0

    def _trajectory_sheds(self) -> bool:
        return bool(self.task.rollout(self.request).availability_loss_kw.any())

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
        requests = self._random(rng, SAMPLES)
        objectives = self.task.search.horizon.evaluate(requests)
        return requests[np.lexsort(np.round(objectives, 4).T[::-1])[:SAMPLED_STARTS]]

    def _kicked(self, rng: np.random.Generator) -> Array:
        """The incumbent with one to three of its free steps shared anew."""
        anew = np.zeros((KICKS, self.request.shape[1]), dtype=bool)
        for kick in range(KICKS):
            anew[kick, rng.permutation(self.free_steps)[: 1 + kick % 3]] = True
        return np.where(anew[:, None, :], self._random(rng, KICKS), self.request)

    def improve(self, starts: Array) -> None:
        """Local search on the control model from each of ``(n, n_strings, n_steps)``."""
        for start in starts:
            request, objectives, _ = self.task.search.horizon.search(start[None], self.limits.rollouts)
            self.incumbent.offer(request, objectives)

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
