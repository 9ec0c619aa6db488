"""In proportion to nominal power times the distance from the temperature at which derating stops a string."""

import numpy as np

from bess.numbers import Array
from bess.parameters import System
from bess.policies.rule import StepDemand, water_fill


def share(system: System, asked: StepDemand) -> Array:
    """Weights are ``p_N (stop_c - temperature)``; a string that is too hot comes last."""
    stop_c = np.array([string.derating.stop_c for string in system.strings])
    weights = system.nominal_kw * np.maximum(stop_c - asked.state.temperature_c, 0.0)
    return water_fill(asked.demand_kw, weights, asked.capability_kw)
