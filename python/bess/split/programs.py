"""From one split problem and one set of coefficients to the relaxations of its lexicographic stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bess.split.coefficients import THETA_UNIT_K, THETA_ZERO_C, Boxes, Coefficients, costs
from bess.split.relaxation import compiled
from bess.split.stage import Settled, Stage

if TYPE_CHECKING:
    from bess.split.search import Task

Array = NDArray[np.float64]

STEEPEST_CUT = 1e4
"""Largest coefficient of shed power in a step cut, per unit."""


class Programs:
    """Relaxations of all stages over the same coefficients.

    Parameters
    ----------
    task, boxes
        The problem, and the states it can reach.
    may_shed : ndarray of bool, shape (n_strings, n_steps)
    coefficients
        Frozen, or ranges over ``boxes``.
    cost : ndarray, shape (n_groups, n_strings, 4)
        Costs of the losses [1/kW].
    step_bound, shed_slope : ndarray, shape (n_steps,)
        Step cuts of the last group.
    """

    def __init__(
        self,
        task: Task,
        boxes: Boxes,
        may_shed: NDArray[np.bool_],
        coefficients: Coefficients,
        cost: Array,
        step_bound: Array,
        shed_slope: Array,
    ) -> None:
        inputs, constants = task.inputs, task.constants
        n_strings, n_steps = inputs.limit_kw.shape
        self._program = compiled(n_strings, n_steps, cost.shape[0] - 1)
        self._cost = cost * constants.scale_kw
        self._units = self._cost.max(axis=(1, 2))
        cut = costs("cut", self._cost[-1] / self._units[-1])
        del cut["cut_a"]
        # The slope grows without limit as the demand vanishes; such a cut says nothing and scales badly.
        useful = shed_slope < STEEPEST_CUT * self._units[-1] / constants.nominal_kw.max()
        self._values = {
            **constants.physics(inputs, boxes, coefficients),
            **cut,
            "cut_a": np.where(useful, shed_slope, 0.0) * constants.nominal_kw[:, None] / self._units[-1],
            "cut_0": np.where(useful, step_bound, 0.0) / self._units[-1],
        }
        alike = task.alike & (np.diff(inputs.state.soc) == 0.0) & (np.diff(inputs.state.temperature_c) == 0.0)
        alike &= np.all(np.diff(inputs.limit_kw, axis=0) == 0.0, axis=1)
        self._settled = Settled(
            may_run=(inputs.limit_kw > 0.0) & (inputs.demand_kw != 0.0),
            may_shed=may_shed,
            may_derate=coefficients.k_lo < 1.0,
            ordered=alike,
            soc=inputs.state.soc,
            theta=(inputs.state.temperature_c - THETA_ZERO_C) / THETA_UNIT_K,
        )

    def stage(
        self,
        group: int,
        caps: Sequence[float],
        incumbent: Callable[[], float],
        propose: Callable[[Array, Array], None],
    ) -> Stage:
        """Minimise ``group`` with the groups before it at most ``caps``."""
        values = {**self._values, **costs("cost", self._cost[group] / self._units[group])}
        for g in range(self._cost.shape[0] - 1):
            active = g < len(caps)
            weight = self._cost[g] / self._units[g] if active else np.zeros_like(self._cost[g])
            values |= costs(f"cap{g}", weight) | {f"cap{g}": caps[g] / self._units[g] if active else 1.0}
        data = self._program.load(values)
        return Stage(self._program, data, self._settled, self._units[group], incumbent, propose)
