"""Demand of the plant: profiles as given, arbitrage on market prices, and forecasts of either."""

from bess.ems.arbitrage import Arbitrage
from bess.ems.forecast import Forecast, Perfect, Persistence
from bess.ems.profile import PROFILES, bundled_profile, read_profile

__all__ = ["PROFILES", "Arbitrage", "Forecast", "Perfect", "Persistence", "bundled_profile", "read_profile"]
