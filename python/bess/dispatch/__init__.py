"""Demand of the plant: profiles, arbitrage on market prices, grid services, and their forecasts."""

from bess.dispatch.arbitrage import Arbitrage
from bess.dispatch.aware import DispatchInputs, DispatchPlan, DynamicProgramDispatch
from bess.dispatch.bands import BandForecast, PriceBands
from bess.dispatch.budget import CycleBudget
from bess.dispatch.connection import GridConnection, PeakTariff, monthly_peaks_kw
from bess.dispatch.forecast import ExternalForecast, Forecast, PerfectForecast, PersistenceForecast
from bess.dispatch.markets import auction_positions, reserve_blocks
from bess.dispatch.meter import GridPowerTarget, min_peak_kw
from bess.dispatch.profile import PROFILES, SITES, bundled_profile, read_profile
from bess.dispatch.reserve import EnergyWindow, RechargeScheduler, droop_response
from bess.dispatch.storage_estimator import StorageEstimator

__all__ = [
    "PROFILES",
    "SITES",
    "Arbitrage",
    "BandForecast",
    "CycleBudget",
    "DispatchInputs",
    "DispatchPlan",
    "DynamicProgramDispatch",
    "EnergyWindow",
    "ExternalForecast",
    "Forecast",
    "GridConnection",
    "GridPowerTarget",
    "PeakTariff",
    "PerfectForecast",
    "PersistenceForecast",
    "PriceBands",
    "RechargeScheduler",
    "StorageEstimator",
    "auction_positions",
    "bundled_profile",
    "droop_response",
    "min_peak_kw",
    "monthly_peaks_kw",
    "read_profile",
    "reserve_blocks",
]
