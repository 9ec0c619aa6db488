"""Objectives in order of priority: each group is minimised under caps on the groups before it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

Result = TypeVar("Result")


def cap(optimum: float, abs_tol: float, rel_tol: float) -> float:
    """Return the largest value a group may take while later groups are minimised, ``F* + max(eps_abs,
    eps_rel |F*|)``."""
    return optimum + max(abs_tol, rel_tol * abs(optimum))


def lexicographic(
    solve: Callable[[int, Sequence[float]], tuple[float, Result]],
    abs_tol: Iterable[float],
    rel_tol: Iterable[float],
) -> list[Result]:
    """Minimise group after group.

    Parameters
    ----------
    solve
        ``solve(group, caps)`` minimises a group with the earlier groups at most ``caps`` and returns the
        objective reached and whatever else is of interest.
    abs_tol, rel_tol
        Tolerances of each group.
    """
    caps: list[float] = []
    results = []
    for group, (absolute, relative) in enumerate(zip(abs_tol, rel_tol, strict=True)):
        objective, result = solve(group, tuple(caps))
        caps.append(cap(objective, absolute, relative))
        results.append(result)
    return results
