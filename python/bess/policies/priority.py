"""Fill one string, then the next, in the order of the system file."""

import numpy as np

from bess.numbers import Array
from bess.parameters import System
from bess.policies.rule import StepDemand


def share(system: System, asked: StepDemand) -> Array:
    """The first string takes all it can, the next what is left, and so on."""
    before_kw = np.concatenate([[0.0], np.cumsum(asked.capability_kw)[:-1]])
    return np.clip(asked.demand_kw - before_kw, 0.0, asked.capability_kw)
