"""What each string can take and give over a control step, with the reserves that settings keep back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bess.arrays import Array, Flags
from bess.edge.serve.valid_state import ValidState
from bess.errors import InputError
from bess.study.sections import ServiceSection
from bess.system import System


@dataclass(frozen=True)
class PowerCapability:
    """Largest magnitudes over a control step [kW], shape ``(n_strings,)``."""

    charge_kw: Array
    discharge_kw: Array

    def towards(self, discharge: bool) -> Array:
        """Those of one direction."""
        return self.discharge_kw if discharge else self.charge_kw

    def only(self, which: Flags) -> PowerCapability:
        """The same of some strings, nothing of the others."""
        return PowerCapability(np.where(which, self.charge_kw, 0.0), np.where(which, self.discharge_kw, 0.0))


class SocLimits:
    """Window of each string: that of its cells, and what the settings leave of it.

    Parameters
    ----------
    system
        The plant's parameters.
    service
        ``soc_floor``, ``soc_ceiling``, ``minimum_power_kw``.
    step_s
        Control step [s].

    Attributes
    ----------
    empty, full : ndarray, shape (n_strings,)
        Window of the cells.
    floor, ceiling : ndarray, shape (n_strings,)
        What is left of it; only a calibration goes beyond.
    minimum_kw : ndarray, shape (n_strings,)
        Least magnitude of a set-point that is not zero.

    Raises
    ------
    InputError
        For settings that leave nothing of a string, or are not of this system's strings.
    """

    def __init__(self, system: System, service: ServiceSection, step_s: float) -> None:
        n = system.n_strings
        self._system, self._step_s = system, step_s
        window = np.array([(s.battery.soc_min, s.battery.soc_max) for s in system.strings])
        self.empty: Array = window[:, 0]
        self.full: Array = window[:, 1]
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

    def room(self, soc: Array, discharge: bool) -> Array:
        """State of charge that is left in one direction, ``>= 0``."""
        return np.maximum(soc - self.floor if discharge else self.ceiling - soc, 0.0)

    def able(self, trusted: ValidState) -> PowerCapability:
        """What strings in this state can take and give until the next control step."""
        return PowerCapability(self._most_kw(trusted, False), self._most_kw(trusted, True))

    def _most_kw(self, trusted: ValidState, discharge: bool) -> Array:
        """By voltage and current, by the energy above the reserve, and by what inverters and plant allow."""
        dt_h = self._step_s / 3600.0
        state = trusted.worse(discharge)
        model = self._system.control_at(trusted.state)
        physical = model.deliverable_kw(np.ascontiguousarray(state.soc), state.temperature_c, discharge, dt_h)
        energy_kwh = self._system.nominal_energy_kwh * state.soh_capacity
        kept = self.room(state.soc, discharge) * energy_kwh / dt_h
        limit = trusted.discharge_kw if discharge else trusted.charge_kw
        return np.maximum(np.minimum(np.minimum(physical, kept), limit), 0.0)


def _each(name: str, value: float | tuple[float, ...], n_strings: int) -> Array:
    """One value for each string."""
    values = np.atleast_1d(np.array(value, dtype=np.float64))
    if values.size not in (1, n_strings):
        raise InputError(f"{name}: {values.size} values for {n_strings} strings")
    return np.array(np.broadcast_to(values, (n_strings,)))
