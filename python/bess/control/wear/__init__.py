"""Wear cost: prices of capacity loss, and marginal rates for optimisers."""

from bess.control.wear.marginal import MarginalWear, WearRates, marginal
from bess.control.wear.prices import WearPrices

__all__ = ["MarginalWear", "WearPrices", "WearRates", "marginal"]
