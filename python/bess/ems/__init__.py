"""Demand of the plant: profiles as given, arbitrage on market prices, services, and forecasts of any."""

from bess.ems.arbitrage import Arbitrage
from bess.ems.aware import AwareDispatch, DispatchPlan, Outlook
from bess.ems.forecast import Forecast, Foretold, Perfect, Persistence
from bess.ems.meter import Level, least_peak_kw
from bess.ems.profile import PROFILES, SITES, bundled_profile, read_profile
from bess.ems.reserve import Recharge, Window, droop_response
from bess.ems.stored import Store

__all__ = [
    "PROFILES",
    "SITES",
    "Arbitrage",
    "AwareDispatch",
    "DispatchPlan",
    "Forecast",
    "Foretold",
    "Level",
    "Outlook",
    "Perfect",
    "Persistence",
    "Recharge",
    "Store",
    "Window",
    "bundled_profile",
    "droop_response",
    "least_peak_kw",
    "read_profile",
]
