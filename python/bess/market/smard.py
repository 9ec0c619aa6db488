"""Exports of SMARD, the platform of the German regulator: German and English, old and new layout.

Clock: Europe/Berlin, without a mark for the repeated hour. The end of the interval is not read: in spring it
is wrong by a day.
"""

import re
from datetime import tzinfo
from typing import Final

import pandas as pd

from bess.errors import listed
from bess.market.files import Repairs, fail
from bess.market.numbers import MISSING, parse_numbers
from bess.market.table import Table
from bess.market.times import clock_of, parse_times, to_utc
from bess.market.units import check_price_unit
from bess.market.zones import SPLIT, check_values, fail_no_zone, only_day_ahead, wanted_codes, zone_code

_PRICE: Final = re.compile(r"(.*?)\s*\[([^\]]*)/MWh\]")
_BOTH: Final = ("Datum von", "Start date", "Beginn")
_DAY: Final = ("Datum", "Date")
_CLOCK: Final = ("Uhrzeit", "Time of day", "Anfang", "Start", "Von", "Start time")
_END: Final = ("Datum bis", "End date")


def matches(table: Table) -> bool:
    """Return whether the header belongs to a price table of SMARD."""
    return table.named(*_BOTH, *_DAY) is not None and any(map(_PRICE.match, table.header))


def read(
    table: Table, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> tuple[pd.DataFrame, tzinfo, str]:
    """Return the day-ahead prices of `zone`, their clock and their product."""
    product = only_day_ahead(product)
    times, clock = _times(table), clock_of(time_zone or "Europe/Berlin")
    return to_utc(times, _prices(table, zone, times["wall"], repairs), clock, repairs), clock, product


def _times(table: Table) -> pd.DataFrame:
    both, end, day, clock = (table.named(*names) for names in (_BOTH, _END, _DAY, _CLOCK))
    if both is not None:
        times = parse_times(table.column(both))
        if end is not None and parse_times(table.column(end)[:1])["wall"].iloc[0] < times["wall"].iloc[0]:
            names = f"{table.header[both]!r} and {table.header[end]!r}"
            text = f"columns {names} are swapped: the interval ends before it begins; swap them back"
            fail(table.lines[0], text)
        return times
    if day is None or clock is None:
        there = listed(table.header)
        fail(1, f"no column for the time of day among {there}; export the table again")
    cells = table.column(day) + " " + table.column(clock)
    return parse_times(cells.rename(f"{table.header[day]} + {table.header[clock]}"))


def _prices(table: Table, zone: str, wall: pd.Series, repairs: Repairs) -> pd.Series:
    """Return the prices of `zone`; before October 2018 those of its predecessor if needed."""
    names = {i: match[1] for i, header in enumerate(table.header) if (match := _PRICE.match(header))}
    filled = (name for i, name in names.items() if not table.column(i).str.lower().isin(MISSING).all())
    there: dict[str, pd.Series] = {}
    for i, name in names.items():
        if (code := zone_code(name)) in wanted_codes(zone):
            check_price_unit(table.header[i])
            german = table.named("Datum von", "Datum") is not None
            values = parse_numbers(table.column(i), "," if german else ".")
            if code not in there or there[code].count() < values.count():
                there[code] = values
    if not there:
        fail_no_zone(zone, filled)
    code, *before = wanted_codes(zone)
    prices = there.get(code, pd.Series(float("nan"), wall.index))
    if before and before[0] in there:
        old = prices.isna() & (wall < SPLIT) & there[before[0]].notna()
        prices = prices.mask(old, there[before[0]])
        repairs.add_where("zone-join", f"took {before[0]} until {SPLIT}", old)
    check_values(zone, prices, filled)
    return prices
