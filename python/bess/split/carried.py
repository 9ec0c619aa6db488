"""What one call of a power split leaves for the next, and whether the next continues it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bess.numbers import Array
from bess.split.problem import SplitProblem
from bess.split.rollout import Rollout

SHARE = 0.1
"""Share of the demand that a forecast may have changed, and of the SOC of a step at nominal power by which a
string may have drifted."""

DRIFT_K = 10.0
"""How far the temperature of a string may be from the expected [K]; in a step that empties it, it is 7 K."""


@dataclass(frozen=True)
class Carried:
    """A schedule for the next call, one step on, and what it was made for.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
    limit_kw : ndarray, shape (n_strings, n_steps), or None
        The limits it was made for, one step on; None of a schedule that was set from outside.
    soc, temperature_c : ndarray, shape (n_strings,), or None
        Where its first step led to; None of a schedule that was set from outside.
    """

    request_kw: Array
    limit_kw: Array | None = None
    soc: Array | None = None
    temperature_c: Array | None = None

    @classmethod
    def after(cls, problem: SplitProblem, request_kw: Array, rollout: Rollout) -> Carried:
        """Carry the schedule of a problem on by one step; its last one is repeated."""
        request_kw, limit_kw = (
            np.concatenate([each[:, 1:], each[:, -1:]], axis=1) for each in (request_kw, problem.limit_kw)
        )
        return cls(request_kw, limit_kw, rollout.soc[:, 0], rollout.temperature_c[:, 0])

    def continues_in(self, problem: SplitProblem) -> bool:
        """Whether a problem is that of the next step: its forecast, limits and state are about as expected.

        A schedule that was made for another problem leads to local optima that a search without it passes by.
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
