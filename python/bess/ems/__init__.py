"""Demand of the plant: profiles as given, arbitrage on market prices, and forecasts of either."""

from bess.ems.arbitrage import Arbitrage
from bess.ems.aware import AwareDispatch, DispatchPlan, Outlook
from bess.ems.forecast import Forecast, Foretold, Perfect, Persistence
from bess.ems.profile import PROFILES, bundled_profile, read_profile

__all__ = [
    "PROFILES",
    "Arbitrage",
    "AwareDispatch",
    "DispatchPlan",
    "Forecast",
    "Foretold",
    "Outlook",
    "Perfect",
    "Persistence",
    "bundled_profile",
    "read_profile",
]
