"""Constraints on set-points: SOC window, power capability, ramps, minimum power, and the sum.

Arrays have one value for each string; powers are kW, positive = discharge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bess.arrays import Array, Flags
from bess.control.policies.rule import water_fill
from bess.edge.serve.measurement_validator import ValidState
from bess.errors import InputError
from bess.study.sections import ServiceSection
from bess.system import System

POWER_TOLERANCE_KW: Final = 1e-9
"""Rounding tolerance of powers: smaller powers switch no inverter."""


@dataclass(frozen=True)
class PowerCapability:
    """Maximum power of each string in both directions over a control step [kW], ``>= 0``."""

    charge_kw: Array
    discharge_kw: Array

    def towards(self, discharge: bool) -> Array:
        """Power limits in one direction."""
        return self.discharge_kw if discharge else self.charge_kw

    def only(self, which: Flags) -> PowerCapability:
        """Capability of some strings; zero for the others."""
        return PowerCapability(np.where(which, self.charge_kw, 0.0), np.where(which, self.discharge_kw, 0.0))


class SocLimits:
    """SOC window of each string by its cells and by the settings, and the capability within it.

    Attributes
    ----------
    empty, full : ndarray, shape (n_strings,)
        SOC window of the cells.
    floor, ceiling : ndarray, shape (n_strings,)
        SOC window of ``service.soc_floor`` and ``soc_ceiling``, which only a calibration exceeds.
    minimum_kw : ndarray, shape (n_strings,)
        Minimum magnitude of a set-point other than zero.
    """

    def __init__(self, system: System, service: ServiceSection, step_s: float) -> None:
        n = system.n_strings
        self._system, self._step_s = system, step_s
        self.empty, self.full = system.soc_window
        minimum_kw = _each("service.minimum_power_kw", service.minimum_power_kw, n)
        self.minimum_kw: Array = np.maximum(minimum_kw, system.min_power_kw)
        self.floor: Array = np.maximum(_each("service.soc_floor", service.soc_floor, n), self.empty)
        self.ceiling: Array = np.minimum(_each("service.soc_ceiling", service.soc_ceiling, n), self.full)
        for i in range(n):
            if self.floor[i] >= self.ceiling[i]:
                raise InputError(
                    f"service.soc_floor = {self.floor[i]:g}: must be below soc_ceiling = "
                    f"{self.ceiling[i]:g} of string {i}"
                )
            if self.minimum_kw[i] > system.nominal_kw[i]:
                raise InputError(
                    f"service.minimum_power_kw = {self.minimum_kw[i]:g} kW: string {i} has "
                    f"{system.nominal_kw[i]:g} kW"
                )

    def left_kwh(self, soc: Array, energy_kwh: Array, discharge: bool) -> Array:
        """Energy within the window in one direction, ``>= 0``."""
        return np.maximum(soc - self.floor if discharge else self.ceiling - soc, 0.0) * energy_kwh

    def able(self, valid: ValidState) -> PowerCapability:
        """Capability until the next control step."""
        return PowerCapability(self._max_kw(valid, False), self._max_kw(valid, True))

    def _max_kw(self, valid: ValidState, discharge: bool) -> Array:
        """Smallest limit by voltage and current, energy within the window, inverter, and plant."""
        dt_h = self._step_s / 3600.0
        state = valid.worse(discharge)
        model = self._system.control_at(valid.state)
        physical = model.deliverable_kw(np.ascontiguousarray(state.soc), state.temperature_c, discharge, dt_h)
        stored = self.left_kwh(state.soc, valid.energy_kwh, discharge) / dt_h
        limit = valid.discharge_kw if discharge else valid.charge_kw
        return np.maximum(np.minimum(np.minimum(physical, stored), limit), 0.0)


def _each(name: str, value: float | tuple[float, ...], n_strings: int) -> Array:
    values = np.atleast_1d(value)
    if values.size not in (1, n_strings):
        raise InputError(f"{name}: {values.size} values for {n_strings} strings")
    return np.full(n_strings, values, dtype=np.float64)


SetPointRange = tuple[Array, Array]
"""Lowest and highest next set-point of each string, signed [kW]."""


def set_point_range(able: PowerCapability, last_kw: Array, ramp_kw: float | None) -> SetPointRange:
    """Range within the capability, and within ``ramp_kw`` of the last set-points.

    Limits have precedence: a set-point above a reduced limit falls to it at once.
    """
    low, high = -able.charge_kw, able.discharge_kw
    if ramp_kw is None:
        return low, high
    nearest = np.clip(last_kw, low, high)
    return np.maximum(low, nearest - ramp_kw), np.minimum(high, nearest + ramp_kw)


def share(
    demand_kw: float, wanted_kw: Array, running: Flags, limits: SetPointRange, minimum_kw: Array
) -> Array:
    """Set-points nearest to the wanted magnitudes, within all constraints, that sum to the demand (signed).

    Only ``running`` strings get power, and those that a ramp keeps above zero. All have the direction of the
    demand, unless a ramp leads away from others. The sum is below the demand where limits, ramps or minimum
    powers require it, and above it only where a ramp does.
    """
    discharge = demand_kw >= 0.0
    low, high = limits if discharge else (-limits[1], -limits[0])
    if (high < 0.0).any():
        # A ramp still keeps a string in the other direction: all go towards zero first.
        return np.asarray(np.clip(0.0, low, high) * (1.0 if discharge else -1.0))
    forced = low > POWER_TOLERANCE_KW
    least = np.where(forced, np.maximum(low, np.minimum(minimum_kw, high)), minimum_kw)
    power = _magnitudes(abs(demand_kw), wanted_kw, (running | forced) & (high >= least), forced, least, high)
    return power if discharge else -power


def _magnitudes(
    demand_kw: float, wanted_kw: Array, active: Flags, forced: Flags, least: Array, most: Array
) -> Array:
    active = active & (most > POWER_TOLERANCE_KW) & (forced | (least <= demand_kw + POWER_TOLERANCE_KW))
    # Minimum powers above the demand in total: the string with the smallest wanted power gets none.
    while least[active].sum() > demand_kw + POWER_TOLERANCE_KW and (active & ~forced).any():
        may_rest = np.flatnonzero(active & ~forced)
        active[may_rest[np.argmin(wanted_kw[may_rest])]] = False
    floor = np.where(active, least, 0.0)
    ceiling = np.where(active, most, 0.0)
    power = np.clip(np.where(active, wanted_kw, 0.0), floor, ceiling)
    rest = demand_kw - float(power.sum())
    if rest > 0.0:
        room = ceiling - power
        power = np.minimum(power + water_fill(rest, room, room), ceiling)
    elif rest < 0.0:
        room = power - floor
        power = np.maximum(power - water_fill(-rest, room, room), floor)
    return power
