"""The electro-thermal plant of the closed loop."""

from bess.plant.ensemble import PlantEnsemble
from bess.plant.flows import Flows, Limit
from bess.plant.plant import Plant
from bess.plant.snapshot import PlantSnapshot

__all__ = ["Flows", "Limit", "Plant", "PlantEnsemble", "PlantSnapshot"]
