"""Best-first branch and bound over binaries, for any relaxation that can solve a node.

A relaxation is known only through :class:`Relaxation`: it solves a node given bounds on the binaries and
says what that established. Only nodes that were solved, or certified infeasible, prune; a node whose solve
failed keeps the bound of its parent and is branched on. Incumbents are the relaxation's business: it is
asked for the best objective it knows.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from itertools import count
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.int8]
INTEGRALITY_TOLERANCE = 1e-6


class Closure(Enum):
    """Why the search ended."""

    GAP = "the gap is closed"
    TREE = "every node is closed, the rest of the gap is in the leaves"
    NODE_LIMIT = "the node limit was reached"
    TIME_LIMIT = "the time limit was reached"
    INFEASIBLE = "no feasible point exists"


@dataclass(frozen=True)
class Node:
    """What solving a node established.

    Attributes
    ----------
    bound : float
        Lower bound of every point of the node; ``inf`` if certified infeasible, ``-inf`` if nothing is known.
    binaries : ndarray or None
        Values of the binaries at the node's optimum, None if there is none.
    """

    bound: float
    binaries: NDArray[np.float64] | None


Objective = Callable[[], float]
"""Tells the objective of the best point known."""


class Relaxation(Protocol):
    """What the search needs to know about a problem."""

    @property
    def n_binaries(self) -> int:
        """Number of binaries."""

    def solve(self, lower: Bits, upper: Bits) -> Node:
        """Solve the relaxation with the binaries between ``lower`` and ``upper``."""

    def incumbent(self) -> float:
        """Objective of the best feasible point known so far, ``inf`` if none."""


@dataclass(frozen=True)
class TreeResult:
    """Result of a search: ``bound <= optimum of the problem``, nodes solved, and why it ended."""

    closure: Closure
    bound: float
    nodes: int


def search(
    relaxation: Relaxation,
    lower: Bits,
    upper: Bits,
    *,
    gap: float,
    node_limit: int,
    deadline: float | None = None,
    abs_gap: float = 1e-9,
    start_bound: float = -np.inf,
) -> TreeResult:
    """Close the gap between the incumbent and the lower bound.

    Parameters
    ----------
    relaxation
        Problem.
    lower, upper : ndarray of int8, shape (n_binaries,)
        Binaries that are settled before the search have equal bounds.
    gap, abs_gap
        Relative and absolute difference of incumbent and bound at which the search stops.
    node_limit
        Largest number of nodes solved.
    deadline
        Stop at this value of ``time.perf_counter()``.
    start_bound
        A bound known beforehand.
    """
    order = count()
    nodes = 0
    closed = np.inf  # smallest bound of the nodes that need no further work
    heap: list[tuple[float, int, Bits, Bits, NDArray[np.float64] | None]] = []

    def visit(lower: Bits, upper: Bits, inherited: float) -> None:
        nonlocal nodes, closed
        answer = relaxation.solve(lower, upper)
        nodes += 1
        bound = max(answer.bound, inherited)
        if bound == np.inf:
            return
        free = upper > lower
        if not free.any() or (answer.binaries is not None and _is_integral(answer.binaries[free])):
            closed = min(closed, bound)
            return
        heapq.heappush(heap, (bound, next(order), lower, upper, answer.binaries))

    visit(lower, upper, start_bound)
    while True:
        best = relaxation.incumbent()
        target = best - max(abs_gap, gap * abs(best)) if np.isfinite(best) else np.inf
        bound = min(closed, heap[0][0] if heap else np.inf)
        if bound >= target:
            closure = Closure.GAP if np.isfinite(best) else Closure.INFEASIBLE
            return TreeResult(closure, min(bound, best), nodes)
        if not heap:
            return TreeResult(Closure.TREE, bound, nodes)
        if closed <= heap[0][0]:
            # The bound cannot rise any more: a leaf holds it down.
            return TreeResult(Closure.TREE, bound, nodes)
        if nodes >= node_limit:
            return TreeResult(Closure.NODE_LIMIT, bound, nodes)
        if deadline is not None and time.perf_counter() >= deadline:
            return TreeResult(Closure.TIME_LIMIT, bound, nodes)
        inherited, _, lower, upper, binaries = heapq.heappop(heap)
        index = _branching_binary(lower, upper, binaries)
        for value in (0, 1):
            child_lower, child_upper = lower.copy(), upper.copy()
            child_lower[index] = child_upper[index] = value
            visit(child_lower, child_upper, inherited)


def _is_integral(values: NDArray[np.float64]) -> bool:
    return bool(np.all(np.minimum(np.abs(values), np.abs(1.0 - values)) <= INTEGRALITY_TOLERANCE))


def _branching_binary(lower: Bits, upper: Bits, values: NDArray[np.float64] | None) -> int:
    """Return the free binary closest to one half, the first of equals."""
    if values is None:
        return int(np.flatnonzero(upper > lower)[0])
    distance = np.where(upper > lower, np.abs(values - 0.5), np.inf)
    return int(np.argmin(np.round(distance, 6)))
