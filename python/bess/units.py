"""Conversions between units, in one place."""

from typing import Final

SECONDS_PER_MINUTE: Final = 60.0
SECONDS_PER_HOUR: Final = 3600.0
SECONDS_PER_DAY: Final = 86_400
WATTS_PER_KW: Final = 1000.0
KWH_PER_MWH: Final = 1000.0
PERCENT: Final = 100.0
ZERO_CELSIUS_K: Final = 273.15
HOURS_PER_DAY: Final = 24.0
DAYS_PER_YEAR: Final = 365.25
