"""The plant as one aggregate store: losses, stored energy and delivered power of all strings."""

from typing import Final

import numpy as np

from bess import _core
from bess.arrays import Array, Flags
from bess.system import State, System
from bess.units import SECONDS_PER_HOUR, WATTS_PER_KW

_REFERENCE_SOC: Final = 0.5
_REFERENCE_C: Final = 35.0
"""State at which the minimum-loss allocation is computed; its losses are scaled to other states."""

_HEAT_WEIGHT: Final = 3.0
"""Weight of battery heat relative to other losses in the allocation: heating causes later derating."""

_SHARES: Final = 24
"""Number of plant powers above zero at which the minimum-loss allocation is computed."""

_POWERS: Final = 8
"""Number of equidistant powers of the dynamic program in each direction."""

_FROM_DERATING_K: Final = (
    *(-45.0, -30.0, -20.0, -13.0, -9.0, -7.0), *np.arange(-5.0, 3.1, 0.5), *(6.0, 12.0, 20.0, 35.0)
)  # fmt: skip
"""Temperature grid of the dynamic program relative to the start of derating; fine where derating begins."""

_WITHOUT_DERATING_C: Final = (0.0, 15.0, 25.0, 35.0, 45.0, 60.0)
"""Temperature grid of the dynamic program for plants without derating."""

_SUBSTEP_H: Final = 1.0 / 12.0
"""Step of the roll-out [h], with the coefficients of its middle."""

_TAPERED_SUBSTEP_H: Final = 1.0 / 60.0
"""Like :data:`_SUBSTEP_H`, for cells with a voltage limit, which reduces a constant power over time."""


def counted(limit_kw: Array) -> Flags:
    """Strings whose energy counts: those in service, or all if none is, because they return."""
    return np.asarray((limit_kw > 0.0) | ~(limit_kw > 0.0).any())


class StringEnergy:
    """Energy of each string above its lower SOC limit over SOC, by the OCV of discharge at 25 degC.

    Attributes
    ----------
    tables : list of tuple of ndarray
        SOC and energy [kWh] of each string, shape (n_points,) each.
    """

    def __init__(self, system: System, soh_capacity: Array):
        self.tables: list[tuple[Array, Array]] = []
        capacity_ah = system.capacity_ah * soh_capacity
        for m, string in enumerate(system.strings):
            ocv = string.battery.ocv_v
            soc = np.unique(np.r_[np.array(ocv.soc), np.linspace(ocv.soc[0], ocv.soc[-1], 101)])
            volt = np.interp(soc, ocv.soc, ocv.discharge_v) * string.battery.cells_series
            energy = np.r_[0.0, np.cumsum(np.diff(soc) * 0.5 * (volt[1:] + volt[:-1]))]
            energy *= capacity_ah[m] / WATTS_PER_KW
            self.tables.append((soc, energy - np.interp(string.battery.soc_min, soc, energy)))

    def kwh(self, soc: Array) -> Array:
        """Return the energies [kWh] at ``soc``; strings along the first axis."""
        return np.array([np.interp(each, *table) for each, table in zip(soc, self.tables, strict=True)])


class Aggregate:
    """All strings of a plant that are in service as one store.

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
        strings = np.ones(system.n_strings)
        self._health = _rounded(state)
        health = State(_REFERENCE_SOC * strings, _REFERENCE_C * strings, *self._health)
        self._model = system.control_at(health)
        batteries = [string.battery for string in system.strings]
        self.soc_min, self.soc_max = system.soc_window
        counts = counted(self.limit_kw)
        self._energy = StringEnergy(system, np.where(counts, health.soh_capacity, 0.0))
        self.string_energy_kwh = self._energy.kwh(self.soc_max)
        self.capacity_kwh = float(self.string_energy_kwh.sum())
        self.off_kw = np.array([s.inverter.off_loss for s in system.strings]) * system.nominal_kw
        lumped = [string.thermal.lumped for string in system.strings]
        mass = counts * np.array([1.0 / (WATTS_PER_KW * each.k1_k_per_j) for each in lumped])
        cooling = np.array([each.k2_per_s for each in lumped])
        self._mass_share = mass / mass.sum()
        self.cooling_per_h = SECONDS_PER_HOUR * float(self._mass_share @ cooling)
        middle = np.clip(np.full(system.n_strings, _REFERENCE_SOC), self.soc_min, self.soc_max)
        self._share_kw = self._allocation(middle, -1.0), self._allocation(middle, 1.0)
        self._shares = _core.BestShares(*self._share_kw, self.limit_kw)
        limits = ((b.cell_voltage_max_v, b.cell_voltage_min_v) for b in batteries)
        tapers = any(limit is not None for pair in limits for limit in pair)
        self._parts = max(1, round(dt_h / (_TAPERED_SUBSTEP_H if tapers else _SUBSTEP_H)))

    def fits(self, state: State, limit_kw: Array) -> bool:
        """Whether the tables apply to this state of health and these inverters in service."""
        return np.array_equal(self.limit_kw, np.minimum(limit_kw, self.system.nominal_kw)) and all(
            np.array_equal(*pair) for pair in zip(self._health, _rounded(state), strict=True)
        )

    def energy_kwh(self, soc: Array) -> Array:
        """Energy above the lower SOC limits, by the OCV of discharge; strings along the first axis."""
        return np.asarray(self._energy.kwh(soc).sum(axis=0))

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

    def store(
        self, energy_kwh: Array, depth: Array, power_kw: tuple[float, float], *, by_throughput: bool
    ) -> _core.Store:
        """Return the states and transitions of the dynamic program.

        Parameters
        ----------
        energy_kwh, depth : ndarray
            Grid points of the stored energy, and of the depth of the present discharge.
        power_kw : tuple of float
            Maximum power of charging, and of discharging.
        by_throughput : bool
            Whether cycles count the mean of charged and discharged AC energy, or discharged stored energy.
        """
        full = np.linspace(self.soc_min, self.soc_max, 201, axis=1)
        share = np.linspace(-1.0, 1.0, 2 * _POWERS + 1)
        power = share * np.where(share < 0.0, *power_kw)
        request = np.zeros((power.size, self.system.n_strings))
        for share_kw, sign in zip(self._share_kw, (-1.0, 1.0), strict=True):
            here = sign * power > 0.0
            request[here] = sign * np.stack(
                [np.interp(np.abs(power[here]), self._total_kw, each) for each in share_kw.T], axis=1
            )
        derated_c = self.derating_begins_c
        return _core.Store(
            self._model,
            energy_kwh=energy_kwh,
            temperature_c=np.array(
                _WITHOUT_DERATING_C if derated_c is None else derated_c + np.array(_FROM_DERATING_K)
            ),
            depth=depth,
            soc=np.array([np.interp(energy_kwh, self.energy_kwh(full), soc) for soc in full]).T,
            power_kw=power,
            request_kw=request,
            energies=self._energy.tables,
            mass_share=self._mass_share,
            off_kw=self.off_kw,
            capacity_kwh=self.capacity_kwh,
            dt_h=self.dt_h,
            parts=self._parts,
            ambient_c=self.system.reference_temperature_c,
            cooling_per_h=self.cooling_per_h,
            by_throughput=by_throughput,
        )

    def track_demand(self, state: State, demand_kw: Array, ambient_c: Array) -> _core.TrackedArrays:
        """Return the response of the control model to a demand that is allocated at minimum loss.

        Power that a full or empty string cannot take is reallocated to the others up to their limits;
        the rest is removed from the demand.

        Returns
        -------
        _core.TrackedArrays
            ``allocated_kw`` (the demand without this rest) and ``delivered_kw`` of each step, signed;
            set-points ``request_kw``, ``(n_strings, n_steps)``; ``soc`` and ``temperature_c`` at the start
            and at the end of each step, ``(n_strings, n_steps + 1)``. Powers are means over the steps.
        """
        return self._model.track_demand(
            state.soc, state.temperature_c, demand_kw, ambient_c, self.dt_h, self._parts, self._shares
        )

    @property
    def _total_kw(self) -> Array:
        """Plant powers of the allocation, from 0 to the power in service."""
        return np.linspace(0.0, self.power_kw, _SHARES + 1)

    def _allocation(self, soc: Array, sign: float) -> Array:
        """Return the minimum-loss powers of the strings in one direction, shape ``(n_points, n_strings)``."""
        strings = self.system.n_strings
        warm_c = np.full(strings, _REFERENCE_C)
        share = np.zeros((_SHARES + 1, strings))
        costs, tolerance = np.ones((1, strings, 4)), np.zeros(1)
        costs[:, :, 3] = _HEAT_WEIGHT
        step = (np.array([self.system.reference_temperature_c]), _SUBSTEP_H, self.limit_kw[:, None])
        for i, total in enumerate(self._total_kw[1:], start=1):
            horizon = _core.ControlHorizon(
                self._model, soc, warm_c, np.array([sign * total]),
                *step, costs, costs, tolerance, tolerance,
            )  # fmt: skip
            share[i] = np.abs(horizon.greedy()[:, 0])
        return share


def _rounded(state: State) -> tuple[Array, Array]:
    """Capacity and resistance rounded to a thousandth, the resolution at which tables are rebuilt."""
    return (
        np.clip(np.round(state.soh_capacity, 3), 0.01, None),
        np.clip(np.round(state.soh_resistance, 3), 0.1, None),
    )
