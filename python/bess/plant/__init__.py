"""The electro-thermal plant: the truth of the closed loop."""

from bess.plant.fleet import Fleet
from bess.plant.flows import Flows, Limit
from bess.plant.plant import Plant
from bess.plant.snapshot import PlantSnapshot

__all__ = ["Fleet", "Flows", "Limit", "Plant", "PlantSnapshot"]
