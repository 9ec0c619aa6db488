"""A lower bound on what any split of a demand could lose in the plant: one linear program over a run.

Its variables are means over control steps, of strings alike together: delivered power ``p``, inverter loss
``w``, heat ``h``, number of inverters that are on ``o``, their warmth ``q`` (the sum of ``theta`` over those
that are on), warmth of all ``s``, and for every level of charge the chemical power ``x`` and energy ``e``.
Whatever a plant does gives values that satisfy every row, and costs no less; ``docs/hindsight.md`` proves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.numbers import Array
from bess.parameters import State, System
from bess.retrospect.cooling import Cooling
from bess.retrospect.optimist import CHARGE, DISCHARGE, Law, Optimist, optimist
from bess.retrospect.program import Program

_HEAT_LEVELS = np.array([0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1, 1.5, 2.2])
"""Loads, as shares of the largest, at which the heat's parabola is touched from below."""
_TYPICAL_K = 15.0
"""Warmth at which it is touched."""
_MOST_FINE = 2
"""Kinds of strings up to which the fine levels take seconds."""
_WARMEST_K = 500.0
"""No string is warmer than this above its surroundings: a box for a variable that is bounded otherwise."""
_ROUNDING = 1e-9
"""What the plant's own rounding may save, relative to the energy asked for."""


@dataclass(frozen=True)
class Worth:
    """What a split is judged by, for each step; see :meth:`energy`.

    Attributes
    ----------
    undelivered : ndarray, shape (n_steps,)
        Cost of a kilowatt-hour that is not delivered; may be negative.
    loss : ndarray, shape (n_steps,)
        Cost of a kilowatt-hour lost in inverters that are on, or in cells, ``>= 0``.
    standby : ndarray, shape (n_steps,)
        Cost of a kilowatt-hour of standby; may be negative.
    """

    undelivered: Array
    loss: Array
    standby: Array

    @classmethod
    def energy(cls, n_steps: int) -> Worth:
        """Count every kilowatt-hour as one."""
        return cls(np.ones(n_steps), np.ones(n_steps), np.ones(n_steps))


def lower_bound(
    system: System,
    state: State,
    demand_kw: Array,
    limit_kw: Array,
    ambient_c: Array,
    *,
    step_s: float,
    law: Law = "table",
    worth: Worth | None = None,
    fine: bool | None = None,
) -> float:
    """Bound from below what the plant loses over a run, however its demand is split.

    Parameters
    ----------
    system
        The plant's parameters.
    state
        In which the run starts; every node of a string at its temperature.
    demand_kw
        Signed demand of each step that strings in service are asked for [kW], shape ``(n_steps,)``.
    limit_kw
        Power of each inverter in service [kW], shape ``(n_steps, n_strings)``.
    ambient_c
        Ambient temperature [degC], shape ``(n_steps,)``.
    step_s
        Control step [s].
    law
        Derating law of the plant.
    worth
        What is counted; by default kilowatt-hours undelivered and lost in inverters and cells.
    fine
        Cut the charge of strings into more levels: a bound that is higher by a few per cent, in minutes where
        many kinds of strings stand together. By default for up to two kinds.

    Returns
    -------
    float
        No split that gives every string a share in the direction of the demand costs less, in kWh or the unit
        of ``worth``. Policies that let one string charge another are outside.
    """
    worth = Worth.energy(demand_kw.size) if worth is None else worth
    dt_h = step_s / 3600.0
    strings = system.strings
    off_kw = np.array([string.inverter.off_loss * string.inverter.nominal_kw for string in strings])
    # While charging an optimist has inverters off if that earns something, and else on.
    charging = demand_kw < 0.0
    standby = np.where(charging, np.minimum(worth.standby, 0.0), worth.standby)
    constant = float(standby.sum()) * float(off_kw.sum()) * dt_h
    active = np.flatnonzero(demand_kw)
    if active.size == 0:
        return constant
    cooling = Cooling.of(system, step_s)
    coldest_c = min(float(ambient_c.min()), float(state.temperature_c.min()))
    common = _Common(active, demand_kw[active], ambient_c, dt_h, worth)
    program = Program()
    delivered = []
    groups = _alike(system, state, limit_kw)
    for members in groups:
        first = members[0]
        hopes = optimist(
            strings[first],
            coldest_c=coldest_c,
            plant_step_s=system.control.plant_step_s,
            law=law,
            fine=len(groups) <= _MOST_FINE if fine is None else fine,
            soh_capacity=float(state.soh_capacity[first]),
            soh_resistance=float(state.soh_resistance[first]),
        )
        own = _Cooling(*(float(v[first]) for v in (cooling.keeps, cooling.takes, cooling.heats)))
        delivered += _group(
            program,
            common,
            hopes,
            own,
            state.soc[members],
            state.temperature_c[members],
            limit_kw[active, first],
        )
    asked_kw = np.abs(common.demand_kw)
    program.at_most(asked_kw, *((power, 1.0) for power in delivered))
    value = program.lower_bound()
    asked = worth.undelivered[active] * asked_kw * dt_h
    return value + float(asked.sum()) + constant - _ROUNDING * float(np.abs(asked).sum())


def _alike(system: System, state: State, limit_kw: Array) -> list[list[int]]:
    """Strings with the same parameters, health and limits, which one set of variables serves."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, string in enumerate(system.strings):
        about = string.model_dump_json(exclude={"site"})
        health = (state.soh_capacity[index], state.soh_resistance[index])
        groups.setdefault((about, health, limit_kw[:, index].tobytes()), []).append(index)
    return list(groups.values())


@dataclass(frozen=True)
class _Common:
    """What all strings have in common: active steps, their demand, all ambient temperatures, what counts."""

    active: NDArray[np.intp]
    demand_kw: Array
    ambient_c: Array
    dt_h: float
    worth: Worth


@dataclass(frozen=True)
class _Cooling:
    """Of one string."""

    keeps: float
    takes: float
    heats: float


def _group(
    program: Program,
    common: _Common,
    hopes: Optimist,
    cooling: _Cooling,
    soc: Array,
    temperature_c: Array,
    limit_kw: Array,
) -> list[NDArray[np.intp]]:
    """Add variables and rows of strings that are alike; return those that add up to delivered power."""
    active, dt_h = common.active, common.dt_h
    count, steps, levels = soc.size, active.size, hopes.energy_kwh.size
    discharging = common.demand_kw > 0.0
    sign = np.where(discharging, 1.0, -1.0)
    asked_kw = np.abs(common.demand_kw)
    largest_kw = np.minimum(np.minimum(hopes.nominal_kw, limit_kw), asked_kw)
    undelivered, loss, standby = (
        values[active] for values in (common.worth.undelivered, common.worth.loss, common.worth.standby)
    )

    def either(discharge: ArrayLike, charge: ArrayLike) -> Array:
        pair = np.array([charge, discharge], dtype=np.float64)
        return np.asarray(pair[discharging.astype(np.intp)])

    ratio = either(hopes.discharge.ratio, hopes.charge.ratio)
    root = either(hopes.discharge.root, hopes.charge.root)
    cold_s, warm_s = np.moveaxis(either(hopes.discharge.conductance, hopes.charge.conductance), 1, 0)

    full_kwh = count * hopes.energy_kwh
    most_x = np.where(discharging[:, None], full_kwh / (ratio * dt_h), asked_kw[:, None])
    most_h = np.where(discharging, most_x.sum(axis=1), asked_kw)
    spared = np.where(discharging, standby * hopes.standby_kw, 0.0)
    x = program.variables((steps, levels), most_x)
    e = program.variables((steps, levels), full_kwh)
    o = program.variables((steps,), np.where(largest_kw > 0.0, count, 0.0), -spared * dt_h)
    q = program.variables((steps,), count * hopes.hottest_k)
    s = program.variables((steps,), count * _WARMEST_K)
    p = program.variables((steps,), np.minimum(count * largest_kw, asked_kw), -undelivered * dt_h)
    w = program.variables((steps,), count * hopes.nominal_kw, loss * dt_h)
    h = program.variables((steps,), most_h, loss * dt_h)
    # Charged with less than their inverters lose, strings deliver without storing, and warm a little.
    burnt_kw, burnt_heat_kw = (np.where(discharging, 0.0, count * most) for most in hopes.burnt_kw)
    burnt = program.variables((steps,), np.minimum(burnt_kw, asked_kw), (loss - undelivered) * dt_h)
    drained_kw = burnt_kw + burnt_heat_kw
    y = program.variables((steps, levels), drained_kw[:, None], (loss * dt_h)[:, None])
    n = program.variables((steps,), burnt_heat_kw)
    program.at_most(drained_kw, (y, 1.0))
    program.at_most(np.zeros(steps), (n, 1.0), (y, -1.0))

    zero = np.zeros(steps)
    # What the inverters pass on is what the cells give or take, and the heat.
    program.at_most(zero, (p, sign), (w, 1.0), (h, 1.0), (x, -sign[:, None]))
    program.at_most(zero, (p, -sign), (w, -1.0), (h, -1.0), (x, sign[:, None]))
    # Energy of each level.
    stored_kwh = np.sum([hopes.stored_kwh(value) for value in soc], axis=0)
    flow = sign[:, None] * ratio * dt_h
    program.at_most(stored_kwh, (e[0], 1.0), (x[0], flow[0]))
    program.at_most(np.zeros((steps - 1, levels)), (e[1:], 1.0), (e[:-1], -1.0), (x[1:], flow[1:]))
    if not hopes.ages:
        # No more vanishes than can: nothing is charged and thrown away.
        flow = sign[:, None] * either(hopes.discharge.ratio_against, hopes.charge.ratio_against) * dt_h
        spill = dt_h * hopes.discharge.ratio_against
        program.at_most(-stored_kwh, (e[0], -1.0), (x[0], -flow[0]), (y[0], -spill))
        program.at_most(
            np.zeros((steps - 1, levels)), (e[1:], -1.0), (e[:-1], 1.0), (x[1:], -flow[1:]), (y[1:], -spill)
        )
        program.at_most(zero, (h, 1.0), (x, -either(hopes.discharge.heat_most, hopes.charge.heat_most)))
        first, more = np.moveaxis(either(hopes.discharge.loss_most, hopes.charge.loss_most), 1, 0)
        program.at_most(zero, (w, 1.0), (o, -first), (p, -more))
    # Delivered power: no more than demand, inverter and temperature allow those that are on.
    program.at_most(zero, (p, 1.0), (o, -largest_kw))
    for intercept, slope in zip(*hopes.derating, strict=True):
        program.at_most(zero, (p, 1.0), (o, -intercept * largest_kw), (q, -slope * largest_kw))
    # Inverter loss.
    for sense, table in ((DISCHARGE, hopes.discharge.loss), (CHARGE, hopes.charge.loss)):
        here = np.flatnonzero(sign == sense)
        for intercept, slope in zip(*table, strict=True):
            program.at_most(zero[here], (p[here], slope), (o[here], intercept), (w[here], -1.0))
    # Heat: (root x)^2 / G from below, by tangents, with G = the conductance of those that are on.
    for level in _HEAT_LEVELS:
        touch = level * largest_kw * root[:, levels // 2] / (cold_s + warm_s * _TYPICAL_K)
        program.at_most(
            zero,
            (x, 2.0 * touch[:, None] * root),
            (o, -(touch**2) * cold_s),
            (q, -(touch**2) * warm_s),
            (h, -1.0),
        )
    # Warmth: of those that are on no more than of all; of all what is left, what air adds and what heat adds.
    program.at_most(zero, (q, 1.0), (o, -hopes.hottest_k))
    air_k = count * cooling.takes * np.maximum(common.ambient_c - hopes.reference_c, 0.0)
    idle_keeps = cooling.keeps ** (np.diff(active, prepend=-1) - 1.0)
    idle_k = _idle(air_k, cooling.keeps, active)
    idle_k[0] += idle_keeps[0] * float(np.maximum(temperature_c - hopes.reference_c, 0.0).sum())
    for of, keeps in ((q, 1.0), (s, cooling.keeps)):
        most_k = keeps * idle_k + air_k[active]
        program.at_most(most_k[:1], (of[:1], 1.0), (h[:1], -cooling.heats), (n[:1], -cooling.heats))
        program.at_most(
            most_k[1:],
            (of[1:], 1.0),
            (s[:-1], -keeps * idle_keeps[1:]),
            (h[1:], -cooling.heats),
            (n[1:], -cooling.heats),
        )
    return [p, burnt]


def _idle(air_k: Array, keeps: float, active: NDArray[np.intp]) -> Array:
    """Warmth [K] that the air adds over the idle steps right before each active one."""
    added, gained, following = np.zeros(active.size), 0.0, 0
    for step in range(int(active[-1]) + 1):
        if step == active[following]:
            added[following], gained, following = gained, 0.0, following + 1
        else:
            gained = keeps * gained + air_k[step]
    return added
