"""Every string the same power, as far as each can."""

import numpy as np

from bess.numbers import Array
from bess.parameters import System
from bess.policies.rule import Task, water_fill


def share(system: System, task: Task) -> Array:
    """Equal powers; what one string cannot take goes to the others in equal parts."""
    return water_fill(task.demand_kw, np.ones(system.n_strings), task.capability_kw)
