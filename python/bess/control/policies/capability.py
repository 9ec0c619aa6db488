"""Power capability of each string over one step, by the control model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.control.policies.policy import PolicyInput
from bess.system import System


class Capability:
    """Maximum power of each string within its SOC window and voltage limits (equation 3)."""

    def __init__(self, system: System, dt_h: float) -> None:
        self._system = system
        self._nominal_kw = system.nominal_kw
        self._dt_h = dt_h

    def __call__(self, inputs: PolicyInput, discharge: bool) -> NDArray[np.float64]:
        """Return AC powers [kW], magnitudes, shape ``(n_strings,)``."""
        state = inputs.state
        model = self._system.control_at(state)
        largest_kw = model.deliverable_kw(state.soc, state.temperature_c, discharge, self._dt_h)
        return np.clip(largest_kw, 0.0, self._nominal_kw)
