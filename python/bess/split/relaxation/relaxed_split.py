"""From one split problem and one set of coefficients to the relaxation of each of its groups."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.numbers import Array
from bess.split.problem import SplitProblem
from bess.split.relaxation.data import THETA_UNIT_K, THETA_ZERO_C, PlantConstants, costs
from bess.split.relaxation.equations import compiled
from bess.split.relaxation.nodes import KnownBefore, RelaxedGroup

STEEPEST_CUT = 1e4
"""Largest coefficient of shed power in a step cut, per unit."""

IN_KW = np.array([0.0, 0.0, 1.0, 1.0])
"""Costs of a cut that counts inverter and battery losses in kW."""


class RelaxedSplit:
    """Relaxations of all groups over the same coefficients.

    Parameters
    ----------
    problem, constants, alike
        The problem; its plant's constants; whether string ``m + 1`` has the parameters of string ``m``.
    control : _core.ControlHorizon
        Its control model.
    boxes, may_shed
        States of the schedules that are of interest ``(n_strings, n_steps + 1)``, and whether one of them
        sheds something ``(n_strings, n_steps)``.
    states, near
        States whose coefficients are taken: the boxes, or the points of a schedule; and those points.
    cost : ndarray, shape (n_groups, n_strings, 4)
        Costs of the losses [1/kW].
    """

    def __init__(
        self,
        problem: SplitProblem,
        constants: PlantConstants,
        alike: NDArray[np.bool_],
        control: _core.ControlHorizon,
        boxes: _core.StateBoxes,
        may_shed: NDArray[np.bool_],
        states: _core.StateBoxes,
        near: _core.StateBoxes,
        cost: Array,
    ) -> None:
        n_strings, n_steps = problem.limit_kw.shape
        constants = constants.at(problem.state)
        coefficients = control.coefficients(states, near)
        self._program = compiled(n_strings, n_steps, cost.shape[0] - 1)
        self._cost = cost * constants.scale_kw
        self._units = self._cost.max(axis=(1, 2))
        self._nominal_kw, self._unit_kw = constants.nominal_kw, constants.scale_kw
        self._control, self._states = control, states
        self._most_shed_kw = np.where(may_shed.any(axis=0), np.abs(problem.demand_kw), 0.0)
        self._values = constants.physics(problem, boxes, coefficients)
        state = problem.state
        for values in (state.soc, state.temperature_c, state.soh_capacity, state.soh_resistance):
            alike = alike & (np.diff(values) == 0.0)
        self._known = KnownBefore(
            may_run=(problem.limit_kw > 0.0) & (problem.demand_kw != 0.0),
            may_shed=may_shed,
            may_derate=coefficients.derating_low < 1.0,
            ordered=alike & np.all(np.diff(problem.limit_kw, axis=0) == 0.0, axis=1),
            soc=state.soc,
            theta=(state.temperature_c - THETA_ZERO_C) / THETA_UNIT_K,
        )

    def group(
        self,
        group: int,
        caps: Sequence[float],
        objective: Callable[[], float],
        propose: Callable[[Array, Array], None],
    ) -> RelaxedGroup:
        """Minimise ``group`` with the groups before it at most ``caps``.

        Parameters
        ----------
        objective
            Tells the objective of the best schedule known.
        propose
            Is told the requests (of nominal power) and the running strings of every node's optimum.
        """
        values: dict[str, Array | float] = {**self._values, **self._step_cuts(group)}
        values |= costs("cost", self._cost[group] / self._units[group])
        for g in range(self._cost.shape[0] - 1):
            active = g < len(caps)
            weight = self._cost[g] / self._units[g] if active else np.zeros_like(self._cost[g])
            values |= costs(f"cap{g}", weight) | {f"cap{g}": caps[g] / self._units[g] if active else 1.0}
        data = self._program.load(values)
        return RelaxedGroup(self._program, data, self._known, self._units[group], objective, propose)

    def _step_cuts(self, group: int) -> dict[str, Array]:
        """Step cuts in the costs of the group; where it has no losses, in kW, because these use up the charge
        that is left."""
        cost = self._cost[group]
        if not cost[:, 1:].any():
            cost = self._unit_kw * IN_KW
        unit = cost.max()
        cuts = self._control.step_bounds(self._states, cost / self._unit_kw, self._most_shed_kw)
        values = costs("cut", cost / unit)
        del values["cut_a"]
        # The slope grows without limit as the demand vanishes; such a cut says nothing and scales badly.
        useful = cuts.shed_slope < STEEPEST_CUT * unit / self._nominal_kw.max()
        return values | {
            "cut_a": np.where(useful, cuts.shed_slope, 0.0) * self._nominal_kw[:, None] / unit,
            "cut_0": np.where(useful, cuts.phi, 0.0) / unit,
        }
