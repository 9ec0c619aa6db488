"""In proportion to nominal power times the distance from the temperature of full derating."""

import numpy as np

from bess.arrays import Array
from bess.control.policies.rule import StepDemand, water_fill
from bess.system import System


def share(system: System, asked: StepDemand) -> Array:
    """Weights are ``p_N (stop_c - temperature)``; a string above ``stop_c`` comes last."""
    stop_c = np.array([string.derating.stop_c for string in system.strings])
    weights = system.nominal_kw * np.maximum(stop_c - asked.state.temperature_c, 0.0)
    return water_fill(asked.demand_kw, weights, asked.capability_kw)
