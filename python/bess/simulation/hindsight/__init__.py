"""Hindsight benchmark of a finished run: the best known schedule and a lower bound."""

from bess.simulation.hindsight.best_known import Hindsight, hindsight
from bess.simulation.hindsight.bound import LossWeights, lower_bound

__all__ = ["Hindsight", "LossWeights", "hindsight", "lower_bound"]
