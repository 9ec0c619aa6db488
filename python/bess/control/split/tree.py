"""Best-first branch and bound, for any relaxation that can solve and branch nodes.

The relaxation implements :class:`Relaxation`: it solves a node and returns a bound and the branches. A node
whose solve failed keeps the bound of its parent and is branched. The relaxation manages incumbents; the
search receives only the best objective known.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import count
from typing import Generic, Protocol, TypeVar

import numpy as np

N = TypeVar("N")


class Closure(Enum):
    """Why the search ended."""

    GAP = "the gap is closed"
    TREE = "every node is closed; the remaining gap is in the leaves"
    TOO_LARGE = "the problem is too large to relax; no node was solved"
    NODE_LIMIT = "the node limit was reached"
    TIME_LIMIT = "the time limit was reached"
    INFEASIBLE = "no feasible point exists"


@dataclass(frozen=True)
class Part(Generic[N]):
    """A part of a node, with its solution if strong branching has already solved it."""

    node: N
    solved: Solved[N] | None = None


Branches = Callable[[Callable[[], bool]], Sequence[Part[N]]]
"""Returns the parts of a node; its argument reports whether the search is over, so that it can stop early."""


@dataclass(frozen=True)
class Solved(Generic[N]):
    """Solution of a node.

    Attributes
    ----------
    bound : float
        Lower bound of every point of the node; ``inf`` if certified infeasible, ``-inf`` without a bound.
    branches : callable or None
        Function that branches the node; None for a leaf.
    """

    bound: float
    branches: Branches[N] | None = None


class Relaxation(Protocol[N]):
    """Interface between the search and a problem."""

    @property
    def nodes(self) -> int:
        """Nodes solved so far, and the number of them solved by strong branching only."""

    def solve(self, node: N) -> Solved[N]:
        """Solve the relaxation of a node."""


@dataclass(frozen=True)
class TreeResult:
    """Result of a search: lower bound of the optimum, number of solved nodes, and reason of termination."""

    closure: Closure
    bound: float
    nodes: int


def search(
    relaxation: Relaxation[N],
    root: N,
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
    relaxation
        Problem.
    root
        Root node.
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
    heap: list[tuple[float, int, Branches[N]]] = []

    def is_late() -> bool:
        return deadline is not None and time.perf_counter() >= deadline

    def is_over() -> bool:
        return relaxation.nodes >= node_limit or is_late()

    def visit(part: Part[N], inherited: float) -> None:
        nonlocal closed
        solved = part.solved or relaxation.solve(part.node)
        bound = max(solved.bound, inherited)
        if solved.branches is None or bound == np.inf:
            closed = min(closed, bound)
            return
        heapq.heappush(heap, (bound, next(order), solved.branches))

    visit(Part(root), start_bound)
    while True:
        best = incumbent()
        target = best - max(abs_gap, gap * abs(best)) if np.isfinite(best) else np.inf
        bound = min(closed, heap[0][0] if heap else np.inf)
        if bound >= target:
            closure = Closure.GAP if np.isfinite(best) else Closure.INFEASIBLE
            return TreeResult(closure, min(bound, best), relaxation.nodes)
        if not heap or closed <= heap[0][0]:
            # The bound cannot rise any more: a leaf limits it.
            return TreeResult(Closure.TREE, bound, relaxation.nodes)
        if relaxation.nodes >= node_limit:
            return TreeResult(Closure.NODE_LIMIT, bound, relaxation.nodes)
        if is_late():
            return TreeResult(Closure.TIME_LIMIT, bound, relaxation.nodes)
        inherited, _, branches = heapq.heappop(heap)
        for part in branches(is_over):
            visit(part, inherited)
