"""Every string the same power, as far as each can."""

import numpy as np

from bess.numbers import Array
from bess.parameters import System
from bess.policies.rule import StepDemand, water_fill


def share(system: System, asked: StepDemand) -> Array:
    """Equal powers; what one string cannot take goes to the others in equal parts."""
    return water_fill(asked.demand_kw, np.ones(system.n_strings), asked.capability_kw)
