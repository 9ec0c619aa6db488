"""What each string can take over one step, by the control model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.parameters import System
from bess.policies.policy import Situation


class Capability:
    """Largest power of each string that its SOC window and its voltage allow (equation 3)."""

    def __init__(self, system: System, dt_h: float) -> None:
        self._system = system
        self._nominal_kw = system.nominal_kw
        self._dt_h = dt_h

    def __call__(self, situation: Situation, discharge: bool) -> NDArray[np.float64]:
        """Return AC powers [kW], magnitudes, shape ``(n_strings,)``."""
        state = situation.state
        model = self._system.control_at(state)
        largest_kw = model.deliverable_kw(state.soc, state.temperature_c, discharge, self._dt_h)
        return np.clip(largest_kw, 0.0, self._nominal_kw)
