"""Shifted warm start of a power split, and the test of its validity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bess.arrays import Array
from bess.control.problem import SplitProblem
from bess.control.rollout import Rollout

SHARE = 0.1
"""Allowed change of the forecast, relative to the demand, and allowed deviation of the SOC, relative to the
SOC change of a step at nominal power."""

DRIFT_K = 10.0
"""Allowed deviation of the string temperature from the expected value [K]; 7 K occurs in a step that empties
the string."""


@dataclass(frozen=True)
class WarmStart:
    """A schedule shifted by one step for the next call, with its expected limits and state."""

    request_kw: Array
    limit_kw: Array | None = None
    """``(n_strings, n_steps)``: expected limits, shifted by one step; None for a schedule set by the user."""
    soc: Array | None = None
    temperature_c: Array | None = None
    """``(n_strings,)``: state after its first step; None for a schedule set by the user."""

    @classmethod
    def after(cls, problem: SplitProblem, request_kw: Array, rollout: Rollout) -> WarmStart:
        """Shift the schedule of a problem by one step and repeat its last step."""
        request_kw, limit_kw = (
            np.concatenate([each[:, 1:], each[:, -1:]], axis=1) for each in (request_kw, problem.limit_kw)
        )
        return cls(request_kw, limit_kw, rollout.soc[:, 0], rollout.temperature_c[:, 0])

    def is_valid_for(self, problem: SplitProblem) -> bool:
        """Whether forecast, limits and state of a problem are close to the expected ones.

        A schedule of a different problem leads to local optima that a search without a warm start avoids.
        """
        demand_kw = problem.demand_kw[:-1]
        changed_kw = np.abs(self.request_kw.sum(axis=0)[:-1] - demand_kw).sum()
        if changed_kw > SHARE * np.abs(demand_kw).sum():
            return False
        if self.limit_kw is not None and not np.array_equal(self.limit_kw[:, :-1], problem.limit_kw[:, :-1]):
            return False
        if self.soc is None or self.temperature_c is None:
            return True
        system, state = problem.system, problem.state
        full_step = system.nominal_kw * problem.dt_h / system.nominal_energy_kwh
        near = np.abs(state.soc - self.soc) <= SHARE * full_step
        near &= np.abs(state.temperature_c - self.temperature_c) <= DRIFT_K
        return bool(near.all())
