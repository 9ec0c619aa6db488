"""What each string can take over one step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.parameters import System
from bess.policies.policy import Situation


class Capability:
    """Estimate from the energy left or the room left at nominal voltage, without losses."""

    def __init__(self, system: System, dt_h: float) -> None:
        self._nominal_kw = system.nominal_kw
        self._full_kw = system.nominal_energy_kwh / dt_h
        self._soc_min = np.array([string.battery.soc_min for string in system.strings])
        self._soc_max = np.array([string.battery.soc_max for string in system.strings])

    def __call__(self, situation: Situation, discharge: bool) -> NDArray[np.float64]:
        """Largest power [kW] of each string in one direction."""
        soc = situation.state.soc
        left = soc - self._soc_min if discharge else self._soc_max - soc
        return np.asarray(np.minimum(self._nominal_kw, np.maximum(left, 0.0) * self._full_kw))
