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

IN_KW = np.array([0.0, 0.0, 1.0, 1.0])
"""Costs of a cut that counts inverter and battery losses in kW."""


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
    step_cut : callable
        Step cuts for given costs ``(n_strings, 4)`` [1/kW]: ``phi`` and the slope of shed power [1/kW], each
        ``(n_steps,)``.
    """

    def __init__(
        self,
        task: Task,
        boxes: Boxes,
        may_shed: NDArray[np.bool_],
        coefficients: Coefficients,
        cost: Array,
        step_cut: Callable[[Array], tuple[Array, Array]],
    ) -> None:
        inputs, constants = task.inputs, task.constants
        n_strings, n_steps = inputs.limit_kw.shape
        self._program = compiled(n_strings, n_steps, cost.shape[0] - 1)
        self._cost = cost * constants.scale_kw
        self._units = self._cost.max(axis=(1, 2))
        self._nominal_kw, self._unit_kw, self._step_cut = constants.nominal_kw, constants.scale_kw, step_cut
        self._values = constants.physics(inputs, boxes, coefficients)
        alike = task.alike & (np.diff(inputs.state.soc) == 0.0) & (np.diff(inputs.state.temperature_c) == 0.0)
        alike &= (np.diff(inputs.state.soh_capacity) == 0.0) & (np.diff(inputs.state.soh_resistance) == 0.0)
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
        values: dict[str, Array | float] = {**self._values, **self._cut(group)}
        values |= costs("cost", self._cost[group] / self._units[group])
        for g in range(self._cost.shape[0] - 1):
            active = g < len(caps)
            weight = self._cost[g] / self._units[g] if active else np.zeros_like(self._cost[g])
            values |= costs(f"cap{g}", weight) | {f"cap{g}": caps[g] / self._units[g] if active else 1.0}
        data = self._program.load(values)
        return Stage(self._program, data, self._settled, self._units[group], incumbent, propose)

    def _cut(self, group: int) -> dict[str, Array]:
        """Step cuts in the costs of the group; where it has no losses, in kW, because these use up the charge
        that is left."""
        cost = self._cost[group]
        if not cost[:, 1:].any():
            cost = self._unit_kw * IN_KW
        unit = cost.max()
        phi, slope = self._step_cut(cost / self._unit_kw)
        cut = costs("cut", cost / unit)
        del cut["cut_a"]
        # The slope grows without limit as the demand vanishes; such a cut says nothing and scales badly.
        useful = slope < STEEPEST_CUT * unit / self._nominal_kw.max()
        return cut | {
            "cut_a": np.where(useful, slope, 0.0) * self._nominal_kw[:, None] / unit,
            "cut_0": np.where(useful, phi, 0.0) / unit,
        }
