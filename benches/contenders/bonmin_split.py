"""The power split as a smooth program, in the language of CasADi, for Bonmin.

Bonmin wants smooth functions, so each table becomes the cubic spline through its knots.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

QUIET = {f"{log}_log_level": 0 for log in ("bb", "nlp", "fp", "milp")}
TOLERANCE = 1e-5


class Program:
    """See :class:`equations.Program`."""

    def __init__(self) -> None:
        self.variables: list[ca.MX] = []
        self.upper: list[float] = []
        self.discrete: list[bool] = []
        self.zero: list[ca.MX] = []
        self.negative: list[ca.MX] = []

    def variable(self, upper: float, discrete: bool = False) -> ca.MX:
        self.variables.append(ca.MX.sym(f"x{len(self.variables)}"))
        self.upper.append(upper)
        self.discrete.append(discrete)
        return self.variables[-1]

    def binary(self) -> ca.MX:
        return self.variable(1.0, discrete=True)

    def table(self, x: Any, knots: np.ndarray, values: np.ndarray) -> Any:
        spline = ca.interpolant("table", "bspline", [list(knots)], list(values))
        return spline(ca.fmin(ca.fmax(x, knots[0]), knots[-1]))

    def named(self, expression: Any, lower: float, upper: float) -> Any:
        return expression

    def equal(self, left: Any, right: Any) -> None:
        self.zero.append(left - right)

    def below(self, left: Any, right: Any) -> None:
        self.negative.append(left - right)

    def minimise(self, objective: Any, gap: float, time_limit_s: float) -> tuple[float, bool]:
        upper, discrete = np.array(self.upper), np.array(self.discrete)
        solver = ca.nlpsol(
            "bonmin",
            "bonmin",
            {"x": ca.vertcat(*self.variables), "f": objective, "g": ca.vertcat(*self.zero, *self.negative)},
            {
                "discrete": list(self.discrete),
                "print_time": False,
                "bonmin": {
                    "allowable_fraction_gap": gap,
                    "time_limit": time_limit_s,
                    "print_level": 0,
                    **QUIET,
                },
            },
        )
        started = time.perf_counter()
        answer = solver(
            x0=np.where(discrete, upper, upper / 2.0),
            lbx=0.0,
            ubx=upper,
            lbg=np.concatenate([np.zeros(len(self.zero)), np.full(len(self.negative), -np.inf)]),
            ubg=0.0,
        )
        elapsed = time.perf_counter() - started
        self.solution = answer["x"]
        finished, status = solver.stats()["success"], solver.stats()["return_status"]
        if not finished and not (status == "LIMIT_EXCEEDED" and self._feasible(discrete)):
            raise RuntimeError(f"Bonmin found no split ({status})")
        return elapsed, finished

    def value(self, term: Any) -> float:
        return float(ca.Function("value", [ca.vertcat(*self.variables)], [term])(self.solution))

    def _feasible(self, discrete: np.ndarray) -> bool:
        """Say whether a solution is one: at the time limit there may be none."""
        off = [abs(self.value(term)) for term in self.zero] + [self.value(term) for term in self.negative]
        binaries = np.array(self.solution).ravel()[discrete]
        return max(off) < TOLERANCE and bool(np.all(np.minimum(binaries, 1.0 - binaries) < TOLERANCE))
