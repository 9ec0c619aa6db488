"""The plant as one aggregate store: losses, stored energy and delivered power of all strings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bess import _core
from bess.arrays import Array
from bess.system import State, System
from bess.units import SECONDS_PER_HOUR, WATTS_PER_KW

ENERGY: Final = 4
"""Where the energy at the end stands in the flows of this module; the temperature is next to it."""

_REFERENCE_SOC: Final = 0.5
_REFERENCE_C: Final = 35.0
"""State at which the best share of each power is found; what it loses is scaled to other states."""

_HEAT_WEIGHT: Final = 3.0
"""Weight of heat beside other losses in the best share: it warms, and derates the hours that follow."""

_POWERS: Final = 24
"""Powers at which the best share is found, between nothing and the plant's nominal power."""

_SUBSTEP_H: Final = 1.0 / 12.0
"""Step of the roll-out [h], with the coefficients of its middle."""

_TAPERED_SUBSTEP_H: Final = 1.0 / 60.0
"""The same for cells with a voltage limit, which cuts a constant power as the voltage rises."""


@dataclass(frozen=True)
class Curve:
    """Minimum-loss allocation of plant power to strings, in one direction.

    Attributes
    ----------
    power_kw : ndarray, shape (n_points,)
        Ascending from 0 to the power in service.
    share_kw : ndarray, shape (n_points, n_strings)
        Power of each string.
    """

    power_kw: Array
    share_kw: Array


@dataclass(frozen=True)
class DispatchRollout:
    """Response of the control model to a schedule; powers are means over the steps.

    Attributes
    ----------
    demand_kw, delivered_kw : ndarray, shape (n_steps,)
        Demand, less the part that no string could take, and what is delivered; signed.
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
        State that gives the state of health of the strings; SOC and temperature are not used.
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
        self.cooling_per_h = SECONDS_PER_HOUR * float(self._mass_share @ cooling)
        middle = np.clip(np.full(system.n_strings, _REFERENCE_SOC), self.soc_min, self.soc_max)
        self.curves = (self._curve(middle, -1.0), self._curve(middle, 1.0))
        charge, discharge = self.curves
        self._shares = _core.BestShares(charge.share_kw, discharge.share_kw, self.limit_kw)
        limits = ((b.cell_voltage_max_v, b.cell_voltage_min_v) for b in batteries)
        tapers = any(limit is not None for pair in limits for limit in pair)
        self._parts = max(1, round(dt_h / (_TAPERED_SUBSTEP_H if tapers else _SUBSTEP_H)))

    def fits(self, state: State, limit_kw: Array) -> bool:
        """Whether the tables apply to this state of health and these inverters in service."""
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

    @property
    def derating_begins_c(self) -> float | None:
        """Lowest temperature at which the derating of a string begins; None without derating."""
        tables = [string.derating for string in self.system.strings]
        begins = [
            np.array(each.temperature_c)[np.array(each.factor) >= 1.0]
            for each in tables
            if min(each.factor) < 1.0
        ]
        return min((float(each.max(initial=-np.inf)) for each in begins), default=None)

    def flows_over(self, energy_kwh: Array, temperature_c: Array, power_kw: Array, steps: int) -> Array:
        """Return the response to signed powers ``(n_powers,)``, allocated at minimum loss, over some steps.

        All strings start alike, at each of the stored energies and temperatures.

        Returns
        -------
        ndarray, shape (n_energies, n_temperatures, n_powers, 6)
            Power asked for, less what full or empty strings cannot take, power delivered, both signed, power
            that derating takes, standby of inverters that are off [kW]; energy [kWh] and mean temperature at
            the end.
        """
        strings = self.system.n_strings
        full = np.linspace(self.soc_min, self.soc_max, 201, axis=1)
        at_energy = np.array([np.interp(energy_kwh, self.energy_kwh(full), soc) for soc in full]).T
        share = np.zeros((power_kw.size, strings))
        for curve, sign in zip(self.curves, (-1.0, 1.0), strict=True):
            here = sign * power_kw > 0.0
            share[here] = sign * np.stack(
                [np.interp(np.abs(power_kw[here]), curve.power_kw, each) for each in curve.share_kw.T], axis=1
            )
        standby_kw = (share == 0.0) @ self._off_kw
        parts = steps * self._parts
        request_kw = np.repeat(share[:, :, None], parts, axis=2)
        ambient_c = np.full(parts, self.system.reference_temperature_c)
        flows = np.empty((energy_kwh.size, temperature_c.size, power_kw.size, 6))
        for i, soc in enumerate(at_energy):
            for j, degrees in enumerate(temperature_c):
                out = self._model.rollout(
                    soc,
                    np.full(strings, degrees),
                    request_kw,
                    ambient_c,
                    self.dt_h / self._parts,
                    midpoint=True,
                )
                shed_kw = out.availability_loss_kw.mean(axis=2).sum(axis=1)
                flows[i, j] = np.stack(
                    [
                        np.sign(power_kw) * np.maximum(np.abs(power_kw) - shed_kw, 0.0),
                        out.delivered_kw.mean(axis=2).sum(axis=1),
                        out.derating_loss_kw.mean(axis=2).sum(axis=1),
                        standby_kw,
                        self.energy_kwh(out.soc[:, :, -1].T),
                        self.mean_c(out.temperature_c[:, :, -1].T),
                    ],
                    axis=1,
                )
        return flows

    def roll_out(self, state: State, demand_kw: Array, ambient_c: Array) -> DispatchRollout:
        """Return the response of the control model to a demand that is allocated at minimum loss.

        Power that a full or empty string cannot take is reallocated to the others up to their limits;
        the rest is removed from the demand.
        """
        flows = self._model.follow(
            state.soc, state.temperature_c, demand_kw, ambient_c, self.dt_h, self._parts, self._shares
        )
        request = flows.request_kw
        return DispatchRollout(
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
        step = (np.array([self.system.reference_temperature_c]), _SUBSTEP_H, self.limit_kw[:, None])
        for i, total in enumerate(power[1:], start=1):
            horizon = _core.ControlHorizon(
                self._model, soc, warm_c, np.array([sign * total]),
                *step, costs, costs, tolerance, tolerance,
            )  # fmt: skip
            share[i] = np.abs(horizon.greedy()[:, 0])
        return Curve(power, share)


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
    """State of health rounded to a thousandth, the resolution at which tables are rebuilt."""
    return State(
        np.full(state.n_strings, _REFERENCE_SOC),
        np.full(state.n_strings, _REFERENCE_C),
        np.clip(np.round(state.soh_capacity, 3), 0.01, None),
        np.clip(np.round(state.soh_resistance, 3), 0.1, None),
    )
