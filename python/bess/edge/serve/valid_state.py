"""What a controller may act upon: measured or estimated states, limits, and the reasons for both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bess.arrays import Array, Flags
from bess.system import State


@dataclass(frozen=True)
class ValidState:
    """What a controller may act upon; arrays of shape ``(n_strings,)``.

    Attributes
    ----------
    state : State
        As measured, or as estimated where a reading is in doubt.
    soc_low, soc_high : ndarray
        Range of the state of charge where two values are possible; else both are that of ``state``.
    charge_kw, discharge_kw : ndarray
        Largest magnitudes that inverters, plant and guard allow; 0 where a string is out.
    in_service : ndarray
        Strings that may run.
    reasons : tuple of str
        Why a string is out, limited or doubted; empty where it is none of these.
    others : ndarray
        Strings to which another controller writes.
    flowing_kw : ndarray
        Power that strings out of service still give, positive = discharge; 0 for strings in service.
    """

    state: State
    soc_low: Array
    soc_high: Array
    charge_kw: Array
    discharge_kw: Array
    in_service: Flags
    reasons: tuple[str, ...]
    others: Flags
    flowing_kw: Array

    @classmethod
    def without_doubt(cls, state: State, nominal_kw: Array) -> ValidState:
        """A plant in this state with every string in service and no limit but its inverter."""
        n = nominal_kw.size
        free = np.ones(n, dtype=bool)
        return cls(state, state.soc, state.soc, nominal_kw, nominal_kw, free, ("",) * n, ~free, np.zeros(n))

    @property
    def limit_kw(self) -> Array:
        """Power of each string in service, in whichever direction it is larger."""
        return np.where(self.in_service, np.maximum(self.charge_kw, self.discharge_kw), 0.0)

    def worse(self, discharge: bool) -> State:
        """The state with which less can be done in one direction."""
        state = self.state
        return State(
            self.soc_low if discharge else self.soc_high,
            state.temperature_c,
            state.soh_capacity,
            state.soh_resistance,
        )
