"""The plant as one store: what all strings together lose, hold and deliver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from bess import _core
from bess.numbers import Array
from bess.parameters import State, System
from bess.units import SECONDS_PER_HOUR, WATTS_PER_KW

CHARGE, DISCHARGE = 0, 1
"""Index of a direction in the arrays of this module."""

_REFERENCE_SOC: Final = 0.5
_REFERENCE_C: Final = 35.0
"""State at which the best share of each power is found; what it loses is scaled to other states."""

_HEAT_WEIGHT: Final = 3.0
"""Weight of heat beside other losses in the best share: it warms, and derates the hours that follow."""

_DEEP: Final = (5.0, 1.5)
"""Growth of resistance at which the store is cut into banks."""

_NEAR_LEAST: Final = 1.02
"""Loss per power that is as good as the least one."""

_PIECES: Final = 5
"""Pieces of the loss curve in each direction."""

_POWERS: Final = 24
"""Powers at which the best share is found, between nothing and the plant's nominal power."""

_TAPER_POINTS: Final = 21
"""Points over SOC at which the power within the voltage limits is taken."""

_TAPERED_SUBSTEP_H: Final = 1.0 / 60.0
"""The same for cells with a voltage limit, which cuts a constant power as the voltage rises."""

_INSTANT_H: Final = 1e-9
"""So short that no string gets full or empty."""

_SUBSTEP_H: Final = 1.0 / 12.0
"""Step of the roll-out [h], with the coefficients of its middle."""


@dataclass(frozen=True)
class Curve:
    """Loss of the plant over its power in one direction, with the power shared as loses least.

    Attributes
    ----------
    power_kw : ndarray, shape (n_points,)
        Ascending from 0 to the power in service.
    share_kw : ndarray, shape (n_points, n_strings)
        Power of each string.
    inverter_kw, heat_kw : ndarray, shape (n_points,)
        Inverter loss, and battery loss at the reference state.
    """

    power_kw: Array
    share_kw: Array
    inverter_kw: Array
    heat_kw: Array

    @property
    def loss_kw(self) -> Array:
        """What is kept low: inverter loss, and heat by its weight."""
        return self.inverter_kw + _HEAT_WEIGHT * self.heat_kw

    def convex_points(self, pieces: int) -> Curve:
        """Return points of the curve with losses per power that rise from piece to piece.

        The first piece ends where the loss per power is least (or above it): less power for longer loses
        more, by what an inverter loses for being on.
        """
        rate = self.loss_kw[1:] / self.power_kw[1:]
        best = 1 + int(np.flatnonzero(rate <= _NEAR_LEAST * rate.min())[-1])
        keep = np.unique(np.r_[0, np.round(np.linspace(best, self.power_kw.size - 1, pieces)).astype(int)])
        return Curve(self.power_kw[keep], self.share_kw[keep], self.inverter_kw[keep], self.heat_kw[keep])


@dataclass(frozen=True)
class Rolled:
    """What a schedule does in the control model, plant by plant; powers are means over the steps.

    Attributes
    ----------
    demand_kw, delivered_kw : ndarray, shape (n_steps,)
        What is asked for, less what no string could take, and what is delivered; signed.
    request_kw : ndarray, shape (n_strings, n_steps)
        What is asked of each string.
    energy_kwh : ndarray, shape (n_steps + 1,)
        Stored above the lower SOC limits, at the start and at the end of each step.
    soc, temperature_c : ndarray, shape (n_strings, n_steps + 1)
        Of each string, likewise.
    standby_kw : ndarray, shape (n_steps,)
        Standby of the inverters that are off.
    starts : int
        Starts of inverters after the first step.
    """

    demand_kw: Array
    delivered_kw: Array
    request_kw: Array
    energy_kwh: Array
    soc: Array
    temperature_c: Array
    standby_kw: Array
    starts: int


class Aggregate:
    """All strings of a plant as one store.

    Parameters
    ----------
    system : System
        The plant.
    dt_h : float
        Control step [h].
    state : State
        Whose state of health the strings have; the rest of it does not matter.
    limit_kw : array, shape (n_strings,)
        Power of each inverter in service, not all 0.
    """

    def __init__(self, system: System, dt_h: float, state: State, limit_kw: Array):
        self.system, self.dt_h = system, dt_h
        self.limit_kw = np.minimum(limit_kw, system.nominal_kw)
        self.power_kw = float(self.limit_kw.sum())
        health = _rounded(state)
        self._health = health
        self._model = system.control_at(health)
        batteries = [string.battery for string in system.strings]
        self.soc_min = np.array([battery.soc_min for battery in batteries])
        self.soc_max = np.array([battery.soc_max for battery in batteries])
        self._soc_grid, self._energy_grid = energy_tables(system, health, self.soc_min)
        self.string_energy_kwh = self._energies_kwh(self.soc_max)
        self.capacity_kwh = float(self.string_energy_kwh.sum())
        self._off_kw = np.array([s.inverter.off_loss for s in system.strings]) * system.nominal_kw
        lumped = [string.thermal.lumped for string in system.strings]
        mass = np.array([1.0 / (WATTS_PER_KW * each.k1_k_per_j) for each in lumped])
        cooling = np.array([each.k2_per_s for each in lumped])
        self._mass_share = mass / mass.sum()
        self.warming_k_per_kwh = SECONDS_PER_HOUR / float(mass.sum())
        self.cooling_per_h = SECONDS_PER_HOUR * float(self._mass_share @ cooling)
        middle = np.clip(np.full(system.n_strings, _REFERENCE_SOC), self.soc_min, self.soc_max)
        self._reference = self._ohm_per_v2(middle[:, None], np.full((system.n_strings, 1), _REFERENCE_C))
        self.curves = (self._curve(middle, -1.0), self._curve(middle, 1.0))
        charge, discharge = self.curves
        self._shares = _core.BestShares(charge.share_kw, discharge.share_kw, self.limit_kw)
        self.stored_per_charged = self._voltage_ratio()
        tapers = any(lines.size for lines in self.tapers)
        self._parts = max(1, round(dt_h / (_TAPERED_SUBSTEP_H if tapers else _SUBSTEP_H)))

    def fits(self, state: State, limit_kw: Array) -> bool:
        """Whether strings of this state and in this service are the ones described here."""
        health = _rounded(state)
        return (
            np.array_equal(self.limit_kw, np.minimum(limit_kw, self.system.nominal_kw))
            and np.array_equal(self._health.soh_capacity, health.soh_capacity)
            and np.array_equal(self._health.soh_resistance, health.soh_resistance)
        )

    def energy_kwh(self, soc: Array) -> Array:
        """Energy above the lower SOC limits, by the OCV of discharge; strings along the first axis."""
        return np.asarray(self._energies_kwh(soc).sum(axis=0))

    def _energies_kwh(self, soc: Array) -> Array:
        return np.array(
            [
                np.interp(each, grid, energy)
                for each, grid, energy in zip(soc, self._soc_grid, self._energy_grid, strict=True)
            ]
        )

    def mean_c(self, temperature_c: Array) -> Array:
        """Temperature of the whole plant; strings along the first axis."""
        return np.tensordot(self._mass_share, temperature_c, axes=1)

    def resistance_factor(self, soc: Array, temperature_c: Array) -> tuple[Array, Array]:
        """Heat at given power over that at the reference state, in charge and in discharge.

        Arrays of shape ``(n_strings, n_steps)``; returns two of shape ``(n_steps,)``.
        """
        now = self._ohm_per_v2(soc, temperature_c)
        weight = self.limit_kw[:, None] ** 2
        charge, discharge = (
            (weight * here).sum(axis=0) / (weight * there).sum(axis=0)
            for here, there in zip(now, self._reference, strict=True)
        )
        return charge, discharge

    @cached_property
    def deep_banks(self) -> tuple[Array, Array]:
        """Parts of the store from the top down: energies [kWh], and resistances over that of the first.

        Resistance climbs steeply towards empty in some cells; there the store is cut where it has grown by
        :data:`_DEEP`.
        """
        soc = np.linspace(self.soc_min, self.soc_max, 201, axis=1)
        factor = np.max(self.resistance_factor(soc, np.full_like(soc, _REFERENCE_C)), axis=0)
        factor = np.maximum.accumulate(factor[::-1])[::-1] / factor[factor.size // 2]
        energy = self.energy_kwh(soc)
        edges = [0, *(int(np.argmax(factor <= level)) for level in _DEEP), soc.shape[1] - 1]
        parts = [(low, high) for low, high in pairwise(sorted(set(edges)))][::-1]
        size = np.array([energy[high] - energy[low] for low, high in parts])
        return size, np.array([factor[low : high + 1].mean() for low, high in parts])

    @cached_property
    def tapers(self) -> tuple[Array, Array]:
        """What the voltage limits allow in charge and in discharge: lines over the stored energy.

        Arrays of shape ``(n_lines, 2)``, slope [1/h] and power at no energy [kW]: the least of them is the
        power that all strings at one SOC can take at :data:`_REFERENCE_C`, or a little more where that is not
        concave. None where no limit binds.
        """
        limits = [(s.battery.cell_voltage_max_v, s.battery.cell_voltage_min_v) for s in self.system.strings]
        soc = np.linspace(self.soc_min, self.soc_max, _TAPER_POINTS, axis=1)
        energy, inside = self.energy_kwh(soc), np.clip(soc.T, self.soc_min + 1e-6, self.soc_max - 1e-6)
        warm_c, found = np.full(self.soc_min.size, _REFERENCE_C), []
        for discharge in (False, True):
            if all(each[discharge] is None for each in limits):
                found.append(np.empty((0, 2)))
                continue
            most = [self._model.deliverable_kw(each, warm_c, discharge, _INSTANT_H) for each in inside]
            power_kw = np.minimum(most, self.limit_kw).sum(axis=1)
            found.append(_lines_above(energy, power_kw, self.power_kw))
        return found[0], found[1]

    @cached_property
    def rising(self) -> tuple[Curve, Curve]:
        """The curves of both directions at few points: losses per power rise from piece to piece."""
        charge, discharge = (curve.convex_points(_PIECES) for curve in self.curves)
        return charge, discharge

    @cached_property
    def derated_lines(self) -> Array:
        """Lines ``a tau + b`` of which the largest is at least what derating takes, shape ``(n, 2)``.

        Over the temperature [degC], as a share of the plant's power: the mean of the strings by their power.
        """
        tables = [string.derating for string in self.system.strings]
        knots = np.unique(np.concatenate([table.temperature_c for table in tables]))
        factors = [np.interp(knots, table.temperature_c, table.factor) for table in tables]
        lost = 1.0 - np.average(factors, axis=0, weights=self.limit_kw)
        start = int(np.flatnonzero(lost <= 0.0)[-1]) if np.any(lost <= 0.0) else 0
        chosen = np.unique(np.round(np.linspace(start, int(np.argmax(lost)), 4)).astype(int))
        slope = np.diff(lost[chosen]) / np.diff(knots[chosen])
        return np.stack([slope, lost[chosen[:-1]] - slope * knots[chosen[:-1]]], axis=1)

    def roll_out(self, state: State, demand_kw: Array, ambient_c: Array) -> Rolled:
        """Return what the control model makes of a demand, shared as loses least.

        What a full or empty string cannot take is given to the others, as far as they have power left, and
        not asked for where they have not.
        """
        flows = self._model.follow(
            state.soc, state.temperature_c, demand_kw, ambient_c, self.dt_h, self._parts, self._shares
        )
        request = flows.request_kw
        return Rolled(
            demand_kw=flows.asked_kw,
            delivered_kw=flows.delivered_kw,
            request_kw=request,
            energy_kwh=self.energy_kwh(flows.soc),
            soc=flows.soc,
            temperature_c=flows.temperature_c,
            standby_kw=self._off_kw @ (request == 0.0),
            starts=int(np.count_nonzero((request[:, 1:] != 0.0) & (request[:, :-1] == 0.0))),
        )

    def _curve(self, soc: Array, sign: float) -> Curve:
        strings = self.system.n_strings
        warm_c = np.full(strings, _REFERENCE_C)
        power = np.linspace(0.0, self.power_kw, _POWERS + 1)
        share = np.zeros((power.size, strings))
        costs, tolerance = np.ones((1, strings, 4)), np.zeros(1)
        costs[:, :, 3] = _HEAT_WEIGHT
        step = (np.array([self.system.cools_towards_c]), _SUBSTEP_H, self.limit_kw[:, None])
        for i, total in enumerate(power[1:], start=1):
            horizon = _core.ControlHorizon(
                self._model, soc, warm_c, np.array([sign * total]),
                *step, costs, costs, tolerance, tolerance,
            )  # fmt: skip
            share[i] = np.abs(horizon.greedy()[:, 0])
        flows = self._model.rollout(soc, warm_c, sign * share[:, :, None], step[0], _SUBSTEP_H)
        inverter, heat = (
            losses[:, :, 0].sum(axis=1) for losses in (flows.inverter_loss_kw, flows.battery_loss_kw)
        )
        return Curve(power, share, inverter, heat)

    def _ohm_per_v2(self, soc: Array, temperature_c: Array) -> tuple[Array, Array]:
        """``R / V^2`` of every string in charge and discharge, arrays of the shape of ``soc``."""
        charge, discharge = (
            resistance / voltage**2 for voltage, resistance in self._coefficients(soc, temperature_c)
        )
        return charge, discharge

    def _coefficients(self, soc: Array, temperature_c: Array) -> list[tuple[Array, Array]]:
        """Voltage [V] and resistance [Ohm] in charge and in discharge."""
        return [self._model.coefficients(soc, temperature_c, discharge) for discharge in (False, True)]

    def _voltage_ratio(self) -> float:
        grid = np.linspace(self.soc_min, self.soc_max, 21, axis=1)
        (charge, _), (discharge, _) = self._coefficients(grid, np.full_like(grid, _REFERENCE_C))
        return float(discharge.sum() / charge.sum())


def _lines_above(energy_kwh: Array, power_kw: Array, most_kw: float) -> Array:
    """Lines ``a E + b`` whose least is the power over the energy, or a little more where that is not concave.

    None that stays at or above ``most_kw``.
    """
    slope = np.diff(power_kw) / np.diff(energy_kwh)
    slope = np.maximum.accumulate(slope[::-1])[::-1]
    start = power_kw[0] + np.r_[0.0, np.cumsum(slope * np.diff(energy_kwh))[:-1]]
    lines = np.stack([slope, start - slope * energy_kwh[:-1]], axis=1)
    below = np.minimum(start, start + slope * np.diff(energy_kwh)) < (1.0 - 1e-6) * most_kw
    return np.asarray(lines[below])


def energy_tables(system: System, health: State, soc_min: Array) -> tuple[list[Array], list[Array]]:
    """Energy [kWh] of each string above its lower SOC limit, over a grid of SOC, at 25 degC."""
    grids, energies = [], []
    capacity_ah = system.capacity_ah * health.soh_capacity
    for m, string in enumerate(system.strings):
        ocv = string.battery.ocv_v
        row = int(np.argmin(np.abs(np.array(ocv.temperature_c) - 25.0)))
        soc = np.unique(np.r_[np.array(ocv.soc), np.linspace(ocv.soc[0], ocv.soc[-1], 101)])
        volt = np.interp(soc, ocv.soc, ocv.discharge[row]) * string.battery.cells_series
        energy = np.r_[0.0, np.cumsum(np.diff(soc) * 0.5 * (volt[1:] + volt[:-1]))]
        energy *= capacity_ah[m] / WATTS_PER_KW
        grids.append(soc)
        energies.append(energy - np.interp(soc_min[m], soc, energy))
    return grids, energies


def _rounded(state: State) -> State:
    """State of health to a thousandth: what a plan can tell apart, and what is worth new tables."""
    return State(
        np.full(state.n_strings, _REFERENCE_SOC),
        np.full(state.n_strings, _REFERENCE_C),
        np.clip(np.round(state.soh_capacity, 3), 0.01, None),
        np.clip(np.round(state.soh_resistance, 3), 0.1, None),
    )
