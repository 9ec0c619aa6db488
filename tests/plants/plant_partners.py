"""What the tests of plants share: a clock that they move, and a plant that remembers its set-points."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bess.plants import PlantLink
from bess.plants.simulated import SimulatedPlant
from bess.plants.simulated_openems import SimulatedEdge
from bess.plants.simulated_sunspec import SimulatedDevices

N = 3
"""Strings."""

Connecting = Callable[..., PlantLink]
Partner = SimulatedEdge | SimulatedDevices


@dataclass
class ManualClock:
    """Stands still until told."""

    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class Watched:
    """A plant that remembers every set-point that reached it, in kW."""

    plant: SimulatedPlant
    clock: ManualClock
    asked: list[tuple[int, float]] = field(default_factory=list)

    def power_kw(self) -> np.ndarray:
        return np.array([reading.power_kw for reading in self.plant.truth()])
