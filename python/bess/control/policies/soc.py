"""In proportion to the stored energy (discharge) or the headroom (charge): the SOCs converge."""

import numpy as np

from bess.arrays import Array
from bess.control.policies.rule import StepDemand, water_fill
from bess.system import System


def share(system: System, asked: StepDemand) -> Array:
    """Weights are the energy [kWh] between the SOC and the end of its window in the direction of power."""
    window = np.array([(string.battery.soc_min, string.battery.soc_max) for string in system.strings])
    left = asked.state.soc - window[:, 0] if asked.discharge else window[:, 1] - asked.state.soc
    weights = np.maximum(left, 0.0) * system.nominal_energy_kwh * asked.state.soh_capacity
    return water_fill(asked.demand_kw, weights, asked.capability_kw)
