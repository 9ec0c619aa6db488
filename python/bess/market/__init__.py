"""Market and weather files of common formats as gap-free UTC series."""

from bess.market.capacity_prices import read_capacity_prices
from bess.market.files import Repair, Repairs
from bess.market.frequency import read_frequency
from bess.market.prices import read_prices
from bess.market.weather import read_weather
from bess.market.years import extended, over_years

__all__ = [
    "Repair",
    "Repairs",
    "extended",
    "over_years",
    "read_capacity_prices",
    "read_frequency",
    "read_prices",
    "read_weather",
]
