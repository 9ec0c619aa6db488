"""Best-first branch and bound, over solved nodes with a bound and a function that branches them.

A node whose solve failed keeps the bound of its parent and is branched. The relaxation manages incumbents;
the search receives only the best objective known.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import count

import numpy as np

from bess.control.split.result import SplitStatus


class Termination(Enum):
    """Reason for the end of a search, with the status of the split."""

    GAP = SplitStatus.CONVEXIFIED_CLOSED
    TREE = SplitStatus.TREE_CLOSED  # the remaining gap is in the leaves
    TOO_LARGE = SplitStatus.TOO_LARGE
    NODE_LIMIT = SplitStatus.NODE_LIMIT
    TIME_LIMIT = SplitStatus.TIME_LIMIT
    INFEASIBLE = SplitStatus.SOLVER_FAILED


Branches = Callable[[], Sequence["Solved"]]
"""Branches a node and returns its parts, solved."""


@dataclass(frozen=True)
class Solved:
    """Solution of a node."""

    bound: float
    """Lower bound of every point of the node; ``inf`` if certified infeasible, ``-inf`` without a bound."""
    branches: Branches | None = None
    """Function that branches the node; None for a leaf."""


@dataclass(frozen=True)
class TreeResult:
    """Result of a search: lower bound of the optimum, number of solved nodes, and reason of termination."""

    reason: Termination
    bound: float
    nodes: int


def search(
    root: Solved,
    nodes: Callable[[], int],
    incumbent: Callable[[], float],
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
    root
        Root node.
    nodes
        Function that returns the number of nodes solved so far.
    incumbent
        Function that returns the objective of the incumbent, ``inf`` if none.
    gap, abs_gap
        Relative and absolute difference of incumbent and bound at which the search stops.
    node_limit
        Maximum number of solved nodes; the second part of a branched node may exceed it.
    deadline
        Stop at this value of ``time.perf_counter()``.
    start_bound
        Initial lower bound.
    """
    order = count()
    closed = np.inf  # smallest bound of the closed nodes
    heap: list[tuple[float, int, Branches]] = []

    def visit(solved: Solved, inherited: float) -> None:
        nonlocal closed
        bound = max(solved.bound, inherited)
        if solved.branches is None or bound == np.inf:
            closed = min(closed, bound)
            return
        heapq.heappush(heap, (bound, next(order), solved.branches))

    visit(root, start_bound)
    while True:
        best = incumbent()
        target = best - max(abs_gap, gap * abs(best)) if np.isfinite(best) else np.inf
        bound = min(closed, heap[0][0] if heap else np.inf)
        if bound >= target:
            reason = Termination.GAP if np.isfinite(best) else Termination.INFEASIBLE
            return TreeResult(reason, min(bound, best), nodes())
        if not heap or closed <= heap[0][0]:
            # A leaf limits the bound.
            return TreeResult(Termination.TREE, bound, nodes())
        if nodes() >= node_limit:
            return TreeResult(Termination.NODE_LIMIT, bound, nodes())
        if deadline is not None and time.perf_counter() >= deadline:
            return TreeResult(Termination.TIME_LIMIT, bound, nodes())
        inherited, _, branches = heapq.heappop(heap)
        for part in branches():
            visit(part, inherited)
