"""Equal power in all strings, within their capability."""

import numpy as np

from bess.arrays import Array
from bess.control.policies.rule import StepDemand, water_fill
from bess.system import System


def share(system: System, asked: StepDemand) -> Array:
    """Equal powers; power above the capability of a string goes to the others in equal parts."""
    return water_fill(asked.demand_kw, np.ones(system.n_strings), asked.capability_kw)
