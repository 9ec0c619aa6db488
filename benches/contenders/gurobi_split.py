"""The power split as a nonconvex program with piecewise linear tables, in Gurobi's language.

The wheel's size-limited licence allows 200 variables with quadratic constraints: two strings, five steps.
"""

from __future__ import annotations

import time
from typing import Any

import gurobipy as gp
import numpy as np


class Program:
    """See :class:`equations.Program`."""

    def __init__(self) -> None:
        self.model = gp.Model(env=gp.Env(params={"OutputFlag": 0, "NonConvex": 2}))

    def variable(self, upper: float) -> Any:
        return self.model.addVar(ub=upper)

    def binary(self) -> Any:
        return self.model.addVar(vtype=gp.GRB.BINARY)

    def table(self, x: Any, knots: np.ndarray, values: np.ndarray) -> Any:
        if isinstance(x, float):
            return float(np.interp(x, knots, values))
        y = self.model.addVar(lb=min(values), ub=max(values))
        flat_knots = [knots[0] - 100.0, *knots, knots[-1] + 100.0]
        self.model.addGenConstrPWL(x, y, flat_knots, [values[0], *values, values[-1]])
        return y

    def named(self, expression: Any, lower: float, upper: float) -> Any:
        y = self.model.addVar(lb=lower, ub=upper)
        self.equal(y, expression)
        return y

    def equal(self, left: Any, right: Any) -> None:
        self.model.addConstr(left == right)

    def below(self, left: Any, right: Any) -> None:
        self.model.addConstr(left <= right)

    def minimise(self, objective: Any, gap: float, time_limit_s: float) -> tuple[float, bool]:
        self.model.Params.MIPGap = gap
        self.model.Params.TimeLimit = time_limit_s
        self.model.setObjective(objective)
        self.model.update()
        started = time.perf_counter()
        self.model.optimize()
        elapsed = time.perf_counter() - started
        if self.model.SolCount == 0:
            raise RuntimeError(f"Gurobi found no split (status {self.model.Status})")
        return elapsed, self.model.Status == gp.GRB.OPTIMAL

    def value(self, term: Any) -> float:
        return float(term.X if isinstance(term, gp.Var) else term.getValue())
