"""A lower bound on undelivered energy and losses of any split of a demand: one conic program over a run.

The variables are means over control steps, summed over identical strings. Strings that are on have delivered
power ``p``, inverter loss ``w``, heat ``h``, number ``o``, sum ``q`` of temperature excesses ``theta``, and,
for each level of charge, chemical power ``x``; all of these once for strings that derate and once for the
others, and both for the time in which one string is on and for that in which several are. All strings have
the sum ``s`` of excesses and the energy ``e`` of each level.
Charging below the inverter loss takes the power ``burnt``, discharges each level by ``y`` and heats by ``n``.
Every operation of the plant satisfies all rows at no lower cost; ``docs/hindsight.md`` has the proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array, ByValue
from bess.simulation.hindsight.cells import CHARGE, DISCHARGE
from bess.simulation.hindsight.relaxed_string import (
    MAX_TEMPERATURE_K,
    Band,
    Law,
    RelaxedString,
    relaxed_string,
)
from bess.simulation.hindsight.safe_program import Program
from bess.simulation.hindsight.thermal_rates import thermal_rates
from bess.system import State, System

_MAX_FINE = 2
"""Maximum number of kinds of strings for which fine levels take only seconds."""
_ROUNDING = 1e-9
"""Margin for rounding errors of the plant, relative to the demanded energy."""


@dataclass(frozen=True, eq=False)
class LossWeights(ByValue):
    """Cost of undelivered energy and losses in each step; see :meth:`energy`.

    Attributes
    ----------
    undelivered : ndarray, shape (n_steps,)
        Cost of undelivered energy [1/kWh]; may be negative.
    loss : ndarray, shape (n_steps,)
        Cost of losses of inverters that are on, and of cells [1/kWh], ``>= 0``.
    standby : ndarray, shape (n_steps,)
        Cost of standby losses [1/kWh]; may be negative.
    """

    undelivered: Array
    loss: Array
    standby: Array

    @classmethod
    def energy(cls, n_steps: int) -> LossWeights:
        """Return unit costs: one for every kilowatt-hour."""
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
    worth: LossWeights | None = None,
    fine: bool | None = None,
) -> float:
    """Return a lower bound on undelivered energy and losses of a run over all splits of its demand.

    Parameters
    ----------
    system
        The plant's parameters.
    state
        State at the start of the run; all nodes of a string have its temperature.
    demand_kw
        Signed demand of each step on the strings in service [kW], shape ``(n_steps,)``.
    limit_kw
        Power of each inverter in service [kW], shape ``(n_steps, n_strings)``.
    ambient_c
        Ambient temperature [degC], shape ``(n_steps,)``.
    step_s
        Control step [s].
    law
        Derating law of the plant.
    worth
        Costs; by default kilowatt-hours of undelivered energy and losses.
    fine
        Divide the charge of strings into more levels, and the time by whether one string is on or several.
        The bound is a few per cent higher, but takes minutes for many kinds of strings. By default for at
        most two kinds.

    Returns
    -------
    float
        Lower bound of the cost [kWh or the unit of ``worth``] of all splits in which every string follows the
        direction of the demand. Policies that charge one string from another are excluded.
    """
    worth = LossWeights.energy(demand_kw.size) if worth is None else worth
    dt_h = step_s / 3600.0
    strings = system.strings
    off_kw = np.array([string.inverter.off_loss * string.inverter.nominal_kw for string in strings])
    # In charge, the relaxation turns inverters off if that reduces the cost, otherwise on.
    charging = demand_kw < 0.0
    standby = np.where(charging, np.minimum(worth.standby, 0.0), worth.standby)
    constant = float(standby.sum()) * float(off_kw.sum()) * dt_h
    active = np.flatnonzero(demand_kw)
    if active.size == 0:
        return constant
    rates = thermal_rates(system, step_s)
    coldest_c = min(float(ambient_c.min()), float(state.temperature_c.min()))
    worth = LossWeights(worth.undelivered[active], worth.loss[active], worth.standby[active])
    groups = _alike(system, state, limit_kw)
    fine = len(groups) <= _MAX_FINE if fine is None else fine
    by_number = [(1, 1), (2, len(strings))] if fine and len(strings) > 1 else [(1, len(strings))]
    program = _Relaxation(active, demand_kw[active], ambient_c - coldest_c, dt_h, worth, by_number)
    for members in groups:
        first = members[0]
        relaxed = relaxed_string(
            strings[first],
            coldest_c=coldest_c,
            plant_step_s=system.control.plant_step_s,
            law=law,
            fine=fine,
            soh_capacity=float(state.soh_capacity[first]),
            soh_resistance=float(state.soh_resistance[first]),
        )
        excess_k, max_kw = state.temperature_c[members] - coldest_c, limit_kw[active, first]
        program.add_group(relaxed, rates[first].tolist(), state.soc[members], excess_k, max_kw)
    program.close()
    value = program.lower_bound()
    asked = worth.undelivered * program.asked_kw * dt_h
    return value + float(asked.sum()) + constant - _ROUNDING * float(np.abs(asked).sum())


def _alike(system: System, state: State, limit_kw: Array) -> list[list[int]]:
    """Strings with equal parameters, health and limits, represented by one set of variables."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, kind in enumerate(system.kinds):
        health = (state.soh_capacity[index], state.soh_resistance[index])
        groups.setdefault((kind, health, limit_kw[:, index].tobytes()), []).append(index)
    return list(groups.values())


class _Running(NamedTuple):
    """Variables of the strings that are on in a band of temperature, while one is on or several are."""

    x: NDArray[np.intp]
    o: NDArray[np.intp]
    q: NDArray[np.intp]
    p: NDArray[np.intp]
    h: NDArray[np.intp]


class _Share(NamedTuple):
    """Share of a step with ``least`` to ``most`` strings on: their variables, by kind and band."""

    least: int
    most: int
    on: list[_Running]


class _Relaxation(Program):
    """The program of a run: active steps, their demand and costs, and the excess of the air in all steps."""

    def __init__(
        self,
        active: NDArray[np.intp],
        demand_kw: Array,
        air_k: Array,
        dt_h: float,
        worth: LossWeights,
        by_number: list[tuple[int, int]],
    ) -> None:
        super().__init__()
        self.active, self.air_k, self.dt_h, self.worth = active, air_k, dt_h, worth
        self.asked_kw, self.sign, self.discharging = np.abs(demand_kw), np.sign(demand_kw), demand_kw > 0.0
        # Row of the coefficients of a direction.
        self.direction = np.where(self.discharging, DISCHARGE, CHARGE)
        self.shares = [_Share(least, most, []) for least, most in by_number]
        self.burnt: list[NDArray[np.intp]] = []

    def close(self) -> None:
        """Add the rows of all strings together."""
        delivered = [*self.burnt, *(running.p for share in self.shares for running in share.on)]
        self.at_most(self.asked_kw, *((power, 1.0) for power in delivered))
        # The number of strings on is `least` to `most` times their share of the step, their power at most
        # this share of the demand, and the shares add up to one at most.
        zero = np.zeros(self.active.size)
        for share in self.shares:
            powers = ((running.p, 1.0) for running in share.on)
            numbers = ((running.o, -self.asked_kw / share.least) for running in share.on)
            self.at_most(zero, *powers, *numbers)
        parts = ((running.o, 1.0 / share.most) for share in self.shares for running in share.on)
        self.at_most(zero + 1.0, *parts)

    def add_group(
        self, string: RelaxedString, rates: list[float], soc: Array, excess_k: Array, limit_kw: Array
    ) -> None:
        """Add variables and rows of identical strings, which join the shares."""
        dt_h, discharging = self.dt_h, self.discharging
        count, steps, levels = soc.size, discharging.size, string.energy_kwh.size
        asked_kw, undelivered, loss = self.asked_kw, self.worth.undelivered, self.worth.loss
        max_kw = np.minimum(np.minimum(string.nominal_kw, limit_kw), asked_kw)
        full_kwh = count * string.energy_kwh
        max_x = np.where(
            discharging[:, None], full_kwh / (string.ratio[self.direction] * dt_h), asked_kw[:, None]
        )
        on: list[_Running] = []
        for share in self.shares:
            number = min(count, share.most)
            running = [self._running(string, band, number, max_kw, max_x) for band in string.bands]
            share.on.extend(running)
            on.extend(running)
        # Strings charged with less than their inverter loss take power without storing it and warm slightly.
        burnt_kw, burnt_heat_kw = (
            np.where(discharging, 0.0, count * power_kw) for power_kw in string.burnt_kw
        )
        burnt = self.add(steps, upper=np.minimum(burnt_kw, asked_kw), cost=(loss - undelivered) * dt_h)
        self.burnt.append(burnt)
        drained_kw = burnt_kw + burnt_heat_kw
        y = self.add((steps, levels), upper=drained_kw[:, None], cost=(loss * dt_h)[:, None])
        n = self.add(steps, upper=burnt_heat_kw)
        self.at_most(drained_kw, (y, 1.0))
        self.at_most(np.zeros(steps), (n, 1.0), (y, -1.0))
        # A string is on in one band at most.
        self.at_most(np.where(max_kw > 0.0, count, 0.0), *((band.o, 1.0) for band in on))
        self._energy(string, on, y, soc)
        self._temperature(rates, [n, *(band.h for band in on)], on, excess_k)

    def _energy(self, string: RelaxedString, on: list[_Running], y: NDArray[np.intp], soc: Array) -> None:
        """Add the energy of each level, from the start to the end of the last step."""
        dt_h, sign, direction = self.dt_h, self.sign[:, None], self.direction
        full_kwh = soc.size * string.energy_kwh
        stored_kwh = np.sum([string.stored_kwh(value) for value in soc], axis=0)
        zero = np.zeros((direction.size, full_kwh.size))
        e = self.add((direction.size + 1, full_kwh.size), upper=np.vstack([stored_kwh, full_kwh + zero]))
        before, after = e[:-1], e[1:]
        flow = sign * string.ratio[direction] * dt_h
        self.at_most(zero, (after, 1.0), (before, -1.0), *((band.x, flow) for band in on))
        # A string fills its levels from below.
        per_kwh = 1.0 / string.energy_kwh
        self.at_most(zero[:, 1:], (after[:, 1:], per_kwh[1:]), (after[:, :-1], -per_kwh[:-1]))
        if not string.cells.ages:
            # Upper limits of losses: stored energy cannot be discarded.
            flow = sign * string.ratio_against[direction] * dt_h
            spill = dt_h * string.ratio_against[DISCHARGE]
            self.at_most(-stored_kwh, (e[0], -1.0))
            self.at_most(zero, (after, -1.0), (before, 1.0), *((band.x, -flow) for band in on), (y, -spill))

    def _temperature(
        self, rates: list[float], heating: list[NDArray[np.intp]], on: list[_Running], excess_k: Array
    ) -> None:
        """Add the sum ``s`` of excesses, from the start to the end of the last step, and ``q <= s``."""
        active = self.active
        keeps, takes, heats = rates
        full_k = np.full(active.size, excess_k.size * MAX_TEMPERATURE_K)
        s = self.add(active.size + 1, upper=np.concatenate([[excess_k.sum()], full_k]))
        air_k = excess_k.size * takes * self.air_k
        idle_keeps = keeps ** (np.diff(active, prepend=-1) - 1.0)
        idle_k = _idle(air_k, keeps, active)
        # Decayed excess + contribution of the air + contribution of heat.
        for of, left in (([band.q for band in on], 1.0), ([s[1:]], keeps)):
            self.at_most(
                left * idle_k + air_k[active],
                *((excess, 1.0) for excess in of),
                (s[:-1], -left * idle_keeps),
                *((heat, -heats) for heat in heating),
            )

    def _running(
        self, string: RelaxedString, band: Band, count: int, max_kw: Array, max_x: Array
    ) -> _Running:
        """Add variables and rows of the strings that are on in a band: ``count`` of them at most.

        Each has a power of at most ``max_kw``; ``max_x`` limits their chemical power.
        """
        steps, levels, dt_h = self.active.size, string.energy_kwh.size, self.dt_h
        discharging, direction, sign = self.discharging, self.direction, self.sign
        asked_kw, worth = self.asked_kw, self.worth
        root = string.root[direction]
        cold_s, warm_s = band.conductance[direction].T
        low_k, high_k = band.theta_k
        saved_standby = np.where(discharging, worth.standby * string.standby_kw, 0.0)
        x = self.add((steps, levels), upper=max_x)
        o = self.add(steps, upper=np.where(max_kw > 0.0, count, 0.0), cost=-saved_standby * dt_h)
        q = self.add(steps, upper=count * high_k)
        p = self.add(steps, upper=np.minimum(count * max_kw, asked_kw), cost=-worth.undelivered * dt_h)
        w = self.add(steps, upper=count * string.nominal_kw, cost=worth.loss * dt_h)
        most_heat_kw = np.where(discharging, max_x.sum(axis=1), asked_kw)
        h = self.add(steps, upper=most_heat_kw, cost=worth.loss * dt_h)

        zero = np.zeros(steps)
        self.at_most(zero, (q, 1.0), (o, -high_k))
        self.at_most(zero, (q, -1.0), (o, low_k))
        # Inverter power = chemical power of the cells + heat.
        self.at_most(zero, (p, sign), (w, 1.0), (h, 1.0), (x, -sign[:, None]))
        self.at_most(zero, (p, -sign), (w, -1.0), (h, -1.0), (x, sign[:, None]))
        if not string.cells.ages:
            self.at_most(zero, (h, 1.0), (x, -string.max_heat[direction]))
            first, more = string.max_loss[direction].T
            self.at_most(zero, (w, 1.0), (o, -first), (p, -more))
        # Delivered power: limited by demand, inverter and temperature.
        self.at_most(zero, (p, 1.0), (o, -max_kw))
        for intercept, slope in zip(*band.derating, strict=True):
            self.at_most(zero, (p, 1.0), (o, -intercept * max_kw), (q, -slope * max_kw))
        # Inverter loss.
        for way in (DISCHARGE, CHARGE):
            here = np.flatnonzero(direction == way)
            for intercept, slope in zip(*string.loss[way], strict=True):
                self.at_most(zero[here], (p[here], slope), (o[here], intercept), (w[here], -1.0))
        # Heat: (sum of root x)^2 <= h G, with the conductance G = cold o + warm q.
        self.at_most_product((x, root), (h, 1.0), (o, cold_s), (q, warm_s))
        return _Running(x, o, q, p, h)


def _idle(air_k: Array, keeps: float, active: NDArray[np.intp]) -> Array:
    """Temperature rise [K] by the air over the idle steps before each active step."""
    added, gained, following = np.zeros(active.size), 0.0, 0
    for step in range(int(active[-1]) + 1):
        if step == active[following]:
            added[following], gained, following = gained, 0.0, following + 1
        else:
            gained = keeps * gained + air_k[step]
    return added
