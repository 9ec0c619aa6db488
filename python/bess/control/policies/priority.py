"""Fill one string, then the next, in the order of the system file."""

import numpy as np

from bess.arrays import Array
from bess.control.policies.rule import StepDemand
from bess.system import System


def share(system: System, asked: StepDemand) -> Array:
    """The first string takes power up to its capability, the next string the remainder, and so on."""
    before_kw = np.concatenate([[0.0], np.cumsum(asked.capability_kw)[:-1]])
    return np.clip(asked.demand_kw - before_kw, 0.0, asked.capability_kw)
