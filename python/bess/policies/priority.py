"""Fill one string, then the next, in the order of the system file."""

import numpy as np

from bess.numbers import Array
from bess.parameters import System
from bess.policies.rule import Task


def share(system: System, task: Task) -> Array:
    """The first string takes all it can, the next what is left, and so on."""
    before_kw = np.concatenate([[0.0], np.cumsum(task.capability_kw)[:-1]])
    return np.clip(task.demand_kw - before_kw, 0.0, task.capability_kw)
