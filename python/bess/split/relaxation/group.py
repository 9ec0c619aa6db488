"""From a split problem, and states to relax it over, to the relaxation of one of its groups."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class RelaxedOver:
    """States over which a problem is relaxed; boxes are of shape ``(n_strings, n_steps + 1)``.

    Attributes
    ----------
    boxes : _core.StateBoxes
        States of the schedules that are of interest.
    may_shed : ndarray of bool, shape (n_strings, n_steps)
        Whether one of these schedules sheds something.
    coefficients : _core.StateBoxes
        States whose coefficients are taken: the boxes again, or the points of a schedule.
    schedule : _core.StateBoxes
        Points of the best schedule known, near which planes are to be tight.
    """

    boxes: _core.StateBoxes
    may_shed: NDArray[np.bool_]
    coefficients: _core.StateBoxes
    schedule: _core.StateBoxes


def relaxed_group(
    problem: SplitProblem,
    control: _core.ControlHorizon,
    constants: PlantConstants,
    cost: Array,
    ceilings: Sequence[float],
    over: RelaxedOver,
    objective: Callable[[], float],
    propose: Callable[[Array, Array], None],
) -> RelaxedGroup:
    """Minimise a group with the groups before it at most ``ceilings``.

    Parameters
    ----------
    problem, control, constants
        The problem, its control model, and the constants of its plant.
    cost : ndarray, shape (n_groups, n_strings, 4)
        Costs of the losses [1/kW].
    ceilings
        Of the objectives of the groups before; as many as there are, so the group is the next one.
    over
        States over which the problem is relaxed.
    objective
        Tells the objective of the best schedule known.
    propose
        Is told the requests (of nominal power) and the running strings of every node's optimum.
    """
    group, n_before = len(ceilings), cost.shape[0] - 1
    n_strings, n_steps = problem.limit_kw.shape
    constants = constants.at(problem.state)
    program = compiled(n_strings, n_steps, n_before)
    coefficients = control.coefficients(over.coefficients, over.schedule)
    most_shed_kw = np.where(over.may_shed.any(axis=0), np.abs(problem.demand_kw), 0.0)
    per_unit = cost * constants.scale_kw
    units = per_unit.max(axis=(1, 2))
    values: dict[str, Array | float] = {
        **constants.physics(problem, over.boxes, coefficients),
        **_step_cuts(per_unit[group], control, constants, over.coefficients, most_shed_kw),
        **costs("cost", per_unit[group] / units[group]),
    }
    for g in range(n_before):
        active = g < group
        weight = per_unit[g] / units[g] if active else np.zeros_like(per_unit[g])
        values |= costs(f"cap{g}", weight) | {f"cap{g}": ceilings[g] / units[g] if active else 1.0}
    state = problem.state
    known = KnownBefore(
        may_run=(problem.limit_kw > 0.0) & (problem.demand_kw != 0.0),
        may_shed=over.may_shed,
        may_derate=coefficients.derating_low < 1.0,
        ordered=constants.alike & _equal_rows(problem.limit_kw) & _interchangeable(over),
        soc=state.soc,
        theta=(state.temperature_c - THETA_ZERO_C) / THETA_UNIT_K,
    )
    return RelaxedGroup(program, program.load(values), known, units[group], objective, propose)


def _interchangeable(over: RelaxedOver) -> NDArray[np.bool_]:
    """Whether a schedule with strings ``m`` and ``m + 1`` exchanged is a point of the relaxation as well.

    Over boxes it is: they hold every schedule of interest, and that one is no worse. Frozen along a schedule,
    coefficients belong to one string each.
    """
    states = over.coefficients
    if states is over.boxes:
        return np.ones(over.may_shed.shape[0] - 1, dtype=bool)
    return _equal_rows(states.soc_low) & _equal_rows(states.temperature_low_c)


def _equal_rows(values: Array) -> NDArray[np.bool_]:
    return np.asarray(np.all(np.diff(values, axis=0) == 0.0, axis=1))


def _step_cuts(
    cost: Array,
    control: _core.ControlHorizon,
    constants: PlantConstants,
    states: _core.StateBoxes,
    most_shed_kw: Array,
) -> dict[str, Array]:
    """Step cuts in the costs ``(n_strings, 4)`` of a group, per unit; where it has no losses, in kW, because
    these use up the charge that is left."""
    if not cost[:, 1:].any():
        cost = constants.scale_kw * IN_KW
    unit = cost.max()
    cuts = control.step_bounds(states, cost / constants.scale_kw, most_shed_kw)
    values = costs("cut", cost / unit)
    del values["cut_a"]
    # The slope grows without limit as the demand vanishes; such a cut says nothing and scales badly.
    useful = cuts.shed_slope < STEEPEST_CUT * unit / constants.nominal_kw.max()
    return values | {
        "cut_a": np.where(useful, cuts.shed_slope, 0.0) * constants.nominal_kw[:, None] / unit,
        "cut_0": np.where(useful, cuts.phi, 0.0) / unit,
    }
