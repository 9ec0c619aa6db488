"""Best-first branch and bound, for any relaxation that can solve a node and cut it in two.

A relaxation is known only through :class:`Relaxation`: it solves a node and says what that established, and
into which nodes it can be cut. A node whose solve failed keeps the bound of its parent and is branched on.
Incumbents are the relaxation's business: the search is given the best objective known.
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
    TREE = "every node is closed, the rest of the gap is in the leaves"
    TOO_LARGE = "nothing was solved: the problem is too large to relax"
    NODE_LIMIT = "the node limit was reached"
    TIME_LIMIT = "the time limit was reached"
    INFEASIBLE = "no feasible point exists"


@dataclass(frozen=True)
class Part(Generic[N]):
    """A part of a node; with what solving it established, if that was tried to see whether to cut here."""

    node: N
    solved: Solved[N] | None = None


Branches = Callable[[Callable[[], bool]], Sequence[Part[N]]]
"""Gives the parts that together are a node; is given what tells whether the search is over, so that no more
is tried."""


@dataclass(frozen=True)
class Solved(Generic[N]):
    """What solving a node established.

    Attributes
    ----------
    bound : float
        Lower bound of every point of the node; ``inf`` if certified infeasible, ``-inf`` if nothing is known.
    branches : callable or None
        How the node is cut; None for a leaf.
    """

    bound: float
    branches: Branches[N] | None = None


class Relaxation(Protocol[N]):
    """What the search needs to know about a problem."""

    @property
    def nodes(self) -> int:
        """Nodes solved so far, those among them that were tried only to see where to cut."""

    def solve(self, node: N) -> Solved[N]:
        """Solve the relaxation of a node."""


@dataclass(frozen=True)
class TreeResult:
    """Result of a search: ``bound <= optimum of the problem``, nodes solved, and why it ended."""

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
        The node that is the whole problem.
    incumbent
        Tells the objective of the best point known, ``inf`` if none.
    gap, abs_gap
        Relative and absolute difference of incumbent and bound at which the search stops.
    node_limit
        Largest number of nodes solved, but for the second part of a node that is cut.
    deadline
        Stop at this value of ``time.perf_counter()``.
    start_bound
        A bound known beforehand.
    """
    order = count()
    closed = np.inf  # smallest bound of the nodes that need no further work
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
            # The bound cannot rise any more: a leaf holds it down.
            return TreeResult(Closure.TREE, bound, relaxation.nodes)
        if relaxation.nodes >= node_limit:
            return TreeResult(Closure.NODE_LIMIT, bound, relaxation.nodes)
        if is_late():
            return TreeResult(Closure.TIME_LIMIT, bound, relaxation.nodes)
        inherited, _, branches = heapq.heappop(heap)
        for part in branches(is_over):
            visit(part, inherited)
