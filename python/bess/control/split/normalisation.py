"""Normalisation of the four losses: constants of the plant, or their ranges over a payoff table."""

from __future__ import annotations

import numpy as np

from bess.arrays import Array
from bess.control.objectives import Costs, Objectives
from bess.control.problem import SplitProblem
from bess.control.split.settings import ROLLOUTS
from bess.system import System

MIN_RANGE = 1e-6
"""A loss with a smaller range does not depend on the split and keeps its constant normalisation."""


def constant_scale(system: System, horizon_steps: int, dt_h: float, objectives: Objectives) -> Array:
    """Return the normalisation of each loss [1/kW], shape ``(n_strings, 4)``.

    It is one constant for the whole plant, so that a kWh of losses has the same weight in every string: the
    loss at nominal power on every string and step or, for ``"energy"``, the length of a step.
    """
    shape = (system.n_strings, 4)
    if objectives.normalisation == "energy":
        return np.full(shape, dt_h)
    inverter_kw, battery_kw = system.control_at(system.initial_state()).nominal_loss_kw()
    nominal = np.stack([system.nominal_kw, system.nominal_kw, inverter_kw, battery_kw], axis=1)
    return np.broadcast_to(1.0 / (nominal.mean(axis=0) * system.n_strings * horizon_steps), shape).copy()


def payoff_scale(problem: SplitProblem, scale_per_kw: Array, objectives: Objectives) -> Array:
    """Return ``scale_per_kw`` divided by the range of each loss over the optima of the single objectives.

    Parameters
    ----------
    problem
        Problem for which the payoff table is computed.
    scale_per_kw : ndarray, shape (n_strings, 4)
        Constant normalisation [1/kW].
    objectives
        Every row of the table minimises the availability loss first, with the tolerances of the first
        objective. Otherwise each loss would be minimal at zero delivery.
    """
    n_losses = scale_per_kw.shape[1]
    single = np.zeros((n_losses, *scale_per_kw.shape))
    single[np.arange(n_losses), :, np.arange(n_losses)] = scale_per_kw.T
    first = [tolerance[0] for tolerance in objectives.tolerances]
    rows = []
    for loss in range(n_losses):
        cost = single[[0, loss]] if loss else single[[0]]
        tolerances = tuple(np.full(len(cost), tolerance) for tolerance in first)
        answer = problem.control(Costs(cost, cost), *tolerances).split(None, ROLLOUTS)
        rows.append(answer.incumbent.request_kw)
    none = np.zeros(n_losses)
    every = problem.control(Costs(single, single), none, none)
    spread = np.ptp(every.evaluate(np.stack(rows)), axis=0)
    return scale_per_kw / np.where(spread < MIN_RANGE, 1.0, spread)
