"""The electro-thermal plant of the closed loop."""

from bess.plant.flows import Flows, Limit, PlantSnapshot
from bess.plant.plant import Plant, PlantEnsemble

__all__ = ["Flows", "Limit", "Plant", "PlantEnsemble", "PlantSnapshot"]
