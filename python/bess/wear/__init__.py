"""What ageing costs: prices of a loss of capacity, and marginal rates for optimisers."""

from bess.wear.marginal import MarginalWear, WearRates, marginal
from bess.wear.prices import WearPrices

__all__ = ["MarginalWear", "WearPrices", "WearRates", "marginal"]
