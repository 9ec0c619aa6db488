"""The power split as a nonconvex program with piecewise linear tables, in SCIP's language."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import Any

import numpy as np
from pyscipopt import Model, quicksum


class Program:
    """See :class:`equations.Program`."""

    def __init__(self) -> None:
        self.model = Model()
        self.model.hideOutput()

    def variable(self, upper: float) -> Any:
        return self.model.addVar(lb=0.0, ub=upper)

    def binary(self) -> Any:
        return self.model.addVar(vtype="B")

    def table(self, x: Any, knots: np.ndarray, values: np.ndarray) -> Any:
        """Fill the segments one after the other: a binary at each knot says that those before it are full.

        Of this, SOS2 constraints and multiple choice, SCIP solves this soonest.
        """
        if isinstance(x, float):
            return float(np.interp(x, knots, values))
        low, high = x.getLbOriginal(), x.getUbOriginal()
        ends = np.array([low, *(knot for knot in knots if low < knot < high), high])
        heights = np.interp(ends, knots, values)
        filled = [self.variable(1.0) for _ in ends[1:]]
        for before, after in pairwise(filled):
            full = self.binary()
            self.below(full, before)
            self.below(after, full)
        y = self.model.addVar(lb=heights.min(), ub=heights.max())
        for term, corners in ((x, ends), (y, heights)):
            steps = zip(np.diff(corners).tolist(), filled, strict=True)
            self.equal(term, float(corners[0]) + quicksum(step * share for step, share in steps))
        return y

    def named(self, expression: Any, lower: float, upper: float) -> Any:
        y = self.model.addVar(lb=lower, ub=upper)
        self.equal(y, expression)
        return y

    def equal(self, left: Any, right: Any) -> None:
        self.model.addCons(left == right)

    def below(self, left: Any, right: Any) -> None:
        self.model.addCons(left <= right)

    def minimise(self, objective: Any, gap: float, time_limit_s: float) -> tuple[float, bool]:
        self.model.setParam("limits/gap", gap)
        self.model.setParam("limits/time", time_limit_s)
        self.model.setObjective(objective)
        started = time.perf_counter()
        try:
            self.model.optimize()
        except Exception as error:  # an LP that breaks down is nothing more particular here
            raise RuntimeError(str(error)) from error
        elapsed = time.perf_counter() - started
        if self.model.getNSols() == 0:
            raise RuntimeError(f"SCIP found no split (status {self.model.getStatus()})")
        return elapsed, self.model.getStatus() in ("optimal", "gaplimit")

    def value(self, term: Any) -> float:
        return float(self.model.getVal(term))
