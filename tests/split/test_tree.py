"""Branch and bound on problems whose optimum is known: knapsack by dynamic programming, subsets by
enumeration."""

import itertools
import time
from typing import NamedTuple

import numpy as np
import pytest

from bess.control.split import tree
from bess.control.split.tree import Solved, Termination

pytestmark = pytest.mark.exhaustive


class Node(NamedTuple):
    """Bound of a relaxation over binaries between bounds, and its optimum, if it has one."""

    bound: float
    binaries: np.ndarray | None


class Binaries:
    """A problem over binaries as the tree sees it: cut at the free binary that is closest to one half."""

    def __init__(self, problem):
        self.problem, self.nodes = problem, 0

    def solve(self, node):
        lower, upper = node
        self.nodes += 1
        answer = self.problem.solve(lower, upper)
        free = upper > lower
        x = np.full(free.size, 0.5) if answer.binaries is None else answer.binaries
        if answer.bound == np.inf or not np.any(free & (np.minimum(x, 1.0 - x) > 1e-6)):
            return Solved(answer.bound)
        index = int(np.argmin(np.where(free, np.abs(x - 0.5), np.inf)))
        return Solved(
            answer.bound, lambda: [self.solve(self.settled(node, index, value)) for value in (0, 1)]
        )

    @staticmethod
    def settled(node, index, value):
        lower, upper = (bounds.copy() for bounds in node)
        lower[index] = upper[index] = value
        return lower, upper


def search(problem, lower, upper, **limits):
    binaries = Binaries(problem)
    root = binaries.solve((lower, upper))
    return tree.search(root, lambda: binaries.nodes, problem.incumbent, **limits)


class Knapsack:
    """Minimise ``-value @ x`` with ``weight @ x <= capacity``; the relaxation is Dantzig's fractional
    bound."""

    def __init__(self, value, weight, capacity):
        self.value, self.weight, self.capacity = value, weight, capacity
        self.best = np.inf
        self.failing = set()
        self.solved = []

    @property
    def n_binaries(self):
        return self.value.size

    def incumbent(self):
        return self.best

    def solve(self, lower, upper):
        self.solved.append((tuple(lower), tuple(upper)))
        if len(self.solved) in self.failing:
            return Node(-np.inf, None)
        x = lower.astype(float)
        room = self.capacity - self.weight @ x
        if room < 0:
            return Node(np.inf, None)
        for i in np.argsort(-self.value / self.weight):
            if upper[i] > lower[i]:
                x[i] = min(1.0, room / self.weight[i])
                room -= x[i] * self.weight[i]
        rounded = np.floor(x)
        self.best = min(self.best, -float(self.value @ rounded))
        return Node(-float(self.value @ x), x)

    def optimum(self):
        best = np.zeros(self.capacity + 1)
        for v, w in zip(self.value, self.weight, strict=True):
            best[w:] = np.maximum(best[w:], best[: best.size - w] + v)
        return -best[-1]


class ClosestSubset:
    """Minimise the distance of ``A x`` to ``target`` over binaries; the relaxation is the box-constrained
    norm."""

    def __init__(self, A, target):
        self.A, self.target, self.best = A, target, np.inf

    @property
    def n_binaries(self):
        return self.A.shape[1]

    def incumbent(self):
        return self.best

    def solve(self, lower, upper):
        x = np.clip(0.5 * np.ones(self.n_binaries), lower, upper)
        step = 1.0 / np.linalg.norm(self.A, 2) ** 2
        y, momentum = x, 1.0
        for _ in range(300):
            new = np.clip(y - step * self.A.T @ (self.A @ y - self.target), lower, upper)
            grown = 0.5 * (1 + np.sqrt(1 + 4 * momentum**2))
            y, x, momentum = new + (momentum - 1) / grown * (new - x), new, grown
        self.best = min(self.best, self._distance(np.round(x)))
        # Lower bound from the tangent plane at x, minimised over the box.
        r = self.A @ x - self.target
        distance = np.linalg.norm(r)
        gradient = self.A.T @ r / max(distance, 1e-12)
        slack = np.where(gradient > 0, gradient * (lower - x), gradient * (upper - x)).sum()
        return Node(distance + slack, x)

    def _distance(self, x):
        return float(np.linalg.norm(self.A @ x - self.target))


def free(n):
    return np.zeros(n, dtype=np.int8), np.ones(n, dtype=np.int8)


def knapsack(seed, n=14):
    rng = np.random.default_rng(seed)
    weight = rng.integers(3, 40, n)
    return Knapsack(weight + rng.integers(1, 10, n).astype(float), weight, int(weight.sum() // 2))


@pytest.mark.parametrize("seed", range(20))
def test_knapsack_optimum_is_that_of_dynamic_programming(seed):
    problem = knapsack(seed)
    outcome = search(problem, *free(14), gap=0.0, node_limit=10_000)
    assert problem.best == problem.optimum()
    assert outcome.bound == pytest.approx(problem.optimum(), abs=1e-9)
    assert outcome.nodes < 2**14 / 4


@pytest.mark.parametrize("seed", range(6))
def test_norm_problem_optimum_is_that_of_enumeration(seed):
    rng = np.random.default_rng(seed)
    problem = ClosestSubset(rng.normal(size=(4, 8)), rng.normal(size=4) * 2)
    outcome = search(problem, *free(8), gap=1e-3, node_limit=10_000)
    best = min(problem._distance(np.array(x)) for x in itertools.product((0.0, 1.0), repeat=8))
    assert problem.best <= best * (1 + 1e-3) + 1e-12
    assert outcome.bound <= best + 1e-12
    assert outcome.reason is Termination.GAP


@pytest.mark.parametrize("limit", [1, 2, 5, 12, 40])
def test_bound_is_valid_and_status_honest_at_any_node_limit(limit):
    problem = knapsack(3)
    outcome = search(problem, *free(14), gap=0.0, node_limit=limit)
    assert outcome.bound <= problem.optimum() + 1e-9
    # Both children of a branching are solved together.
    assert outcome.nodes <= limit + 1
    assert (outcome.reason is Termination.NODE_LIMIT) == (outcome.bound < problem.best - 1e-9)


def test_nodes_whose_solve_failed_do_not_prune():
    problem = knapsack(5)
    problem.failing = {1, 2, 4, 7}
    outcome = search(problem, *free(14), gap=0.0, node_limit=10_000)
    assert problem.best == problem.optimum()
    assert outcome.reason is Termination.GAP


def test_a_failed_leaf_keeps_the_bound_open():
    class Failing(Knapsack):
        def solve(self, lower, upper):
            return (
                super().solve(lower, upper)
                if (lower == 0).any() and (upper == 1).any()
                else Node(-np.inf, None)
            )

    problem = Failing(np.array([2.0, 3.0]), np.array([2, 3]), 4)
    outcome = search(problem, *free(2), gap=0.0, node_limit=100)
    assert outcome.reason in (Termination.TREE, Termination.GAP)
    assert outcome.bound <= problem.optimum()


def test_time_limit_stops_with_a_valid_bound():
    problem = knapsack(3)
    outcome = search(problem, *free(14), gap=0.0, node_limit=10_000, deadline=time.perf_counter() - 1.0)
    assert outcome.reason is Termination.TIME_LIMIT
    assert outcome.nodes == 1
    assert outcome.bound <= problem.optimum()


def test_infeasible_problem_is_reported_as_such():
    problem = Knapsack(np.ones(2), np.array([5, 5]), 4)
    outcome = search(problem, np.ones(2, dtype=np.int8), np.ones(2, dtype=np.int8), gap=0.0, node_limit=10)
    assert outcome.reason is Termination.INFEASIBLE
    assert outcome.bound == np.inf


def test_settled_binaries_stay_settled():
    problem = knapsack(1)
    lower, upper = free(14)
    lower[2], upper[5] = 1, 0
    search(problem, lower, upper, gap=0.0, node_limit=10_000)
    assert all(low[2] == 1 and up[5] == 0 for low, up in problem.solved)


def test_search_is_deterministic():
    runs = []
    for _ in range(2):
        problem = knapsack(8)
        search(problem, *free(14), gap=0.0, node_limit=10_000)
        runs.append(problem.solved)
    assert runs[0] == runs[1]


def test_a_gap_already_closed_needs_one_node():
    problem = knapsack(2)
    problem.best = problem.optimum()
    assert search(problem, *free(14), gap=0.5, node_limit=100).nodes == 1


class FailingLeaves:
    """Two binaries; inner nodes have the bound 0, every leaf fails, and the optimum, 1, is in one of them."""

    n_binaries = 2

    def __init__(self, known):
        self.known = known

    def incumbent(self):
        return self.known

    def solve(self, lower, upper):
        if (lower == upper).all():
            return Node(-np.inf, None)
        return Node(0.0, np.where(lower < upper, 0.5, lower).astype(float))


@pytest.mark.parametrize("known", [10.0, np.inf])
def test_unsolved_leaves_limit_the_bound(known):
    outcome = search(FailingLeaves(known), *free(2), gap=1e-3, node_limit=100)
    assert outcome.reason is Termination.TREE
    assert outcome.bound <= 1.0


def test_a_bound_is_never_below_what_was_known_before():
    outcome = search(FailingLeaves(10.0), *free(2), gap=1e-3, node_limit=100, start_bound=0.75)
    assert 0.75 <= outcome.bound <= 1.0


def test_a_node_with_an_integral_optimum_is_closed_and_still_holds_the_bound_down():
    class Integral:
        """The root's optimum is integral at 2; what is known costs 3."""

        n_binaries = 2

        def incumbent(self):
            return 3.0

        def solve(self, lower, upper):
            return Node(2.0, np.array([0.0, 1.0]))

    outcome = search(Integral(), *free(2), gap=1e-3, node_limit=100)
    assert (outcome.reason, outcome.bound, outcome.nodes) == (Termination.TREE, 2.0, 1)


@pytest.mark.parametrize(("known", "closed"), [(1.0005, True), (1.01, False)])
def test_the_gap_is_closed_within_the_relative_gap_and_not_beyond(known, closed):
    class Root:
        n_binaries = 1

        def incumbent(self):
            return known

        def solve(self, lower, upper):
            return Node(1.0, np.array([0.5]))

    outcome = search(Root(), *free(1), gap=1e-3, node_limit=1)
    assert (outcome.reason is Termination.GAP) == closed
    assert outcome.bound <= known


class Leaves:
    """One binary: its relaxation, and a leaf for each value whose bound is below its own optimum."""

    n_binaries = 1

    def __init__(self, root, leaves, best):
        self.root, self.leaves, self.best = root, leaves, best

    def incumbent(self):
        return self.best

    def solve(self, lower, upper):
        if upper[0] > lower[0]:
            return Node(self.root, np.array([0.5]))
        return Node(self.leaves[lower[0]], np.array([float(lower[0])]))


def test_a_closed_gap_reports_what_is_proven_and_not_the_best_known():
    outcome = search(Leaves(9.95, (9.99, 9.97), 10.0), *free(1), gap=1e-2, node_limit=9)
    assert (outcome.reason, outcome.bound) == (Termination.GAP, 9.95)
    # Bounds above the best known say that nothing is better than it.
    outcome = search(Leaves(9.0, (11.0, 12.0), 10.0), *free(1), gap=1e-2, node_limit=9)
    assert (outcome.reason, outcome.bound) == (Termination.GAP, 10.0)


class Held(Leaves):
    """Two binaries, of which the second matters only where the first is 1."""

    n_binaries = 2

    def solve(self, lower, upper):
        if upper[0] == 0:
            return Node(self.leaves[0], np.zeros(2))
        return Node(self.root if lower[0] == 0 else self.leaves[1], np.array([0.5, 0.5]))


def test_a_tree_limited_by_a_leaf_ends_with_the_bound_of_that_leaf():
    outcome = search(Held(1.0, (2.0, 3.0), 10.0), *free(2), gap=0.0, node_limit=99)
    assert (outcome.reason, outcome.bound, outcome.nodes) == (Termination.TREE, 2.0, 3)
