"""What demand is foreseen where the caller says nothing: that of the same time of the day before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from bess.arrays import Array
from bess.edge.serve.persistent import Persistent

SMOOTH_S: Final = 300.0
"""Time over which a demand that fluctuates is smoothed for the plan."""


class Forecast(Persistent):
    """Remembers the mean demand of each step of the day, as it was when it last came.

    Parameters
    ----------
    step_s
        Control step [s].
    plan_s
        Step of the plan [s].
    n_steps
        Steps that the plan looks ahead.
    """

    kept = ("_day_kw", "_mean", "_smooth_kw")

    def __init__(self, step_s: float, plan_s: float, n_steps: int) -> None:
        self._step_s, self._n_steps = step_s, n_steps
        self._day_kw: Array = np.full(max(1, round(86_400.0 / plan_s)), np.nan)
        # Of the step of the plan that is going on: its number, mean demand so far [kW], time so far [s].
        self._mean: tuple[int, float, float] = (-1, 0.0, 0.0)
        self._smooth_kw: float | None = None

    def __call__(
        self, demand_kw: float, slot: int, elapsed_s: float, given_kw: Sequence[float] | Array | None
    ) -> Array:
        """Take down the demand of now, and foresee that of the plan's steps.

        Parameters
        ----------
        demand_kw
            Now.
        slot
            Number of the present step of the plan.
        elapsed_s
            Time since the last call.
        given_kw
            What the caller foresees, the present step first; zero after its end.

        Returns
        -------
        ndarray, shape (n_steps,)
            The present step first.
        """
        self._take_down(demand_kw, slot, elapsed_s)
        if given_kw is not None:
            ahead = np.asarray(given_kw, dtype=np.float64)[: self._n_steps]
            return np.concatenate([ahead, np.zeros(self._n_steps - ahead.size)])
        ahead = np.nan_to_num(self._day_kw[(slot + np.arange(self._n_steps)) % self._day_kw.size])
        weight = 1.0 if self._smooth_kw is None else min(1.0, self._step_s / SMOOTH_S)
        self._smooth_kw = (1.0 - weight) * (self._smooth_kw or 0.0) + weight * demand_kw
        ahead[0] = self._smooth_kw
        return ahead

    def day(self, slot: int, given_kw: Sequence[float] | Array | None) -> Array:
        """Demand of the plan's steps of a day: what the caller foresees, then that of the day before."""
        ahead = np.nan_to_num(self._day_kw[(slot + np.arange(self._day_kw.size)) % self._day_kw.size])
        given = np.array([] if given_kw is None else given_kw, dtype=np.float64)[: ahead.size]
        ahead[: given.size] = given
        return ahead

    def _take_down(self, demand_kw: float, slot: int, elapsed_s: float) -> None:
        known, mean, weight_s = self._mean
        if slot != known:
            if known >= 0:
                self._day_kw[known % self._day_kw.size] = mean
            mean, weight_s = 0.0, 0.0
        span_s = max(min(elapsed_s, self._step_s), 1e-3)
        mean = (mean * weight_s + demand_kw * span_s) / (weight_s + span_s)
        self._mean = (slot, mean, weight_s + span_s)
