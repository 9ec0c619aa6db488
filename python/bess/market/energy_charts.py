"""Exports of Energy-Charts: day-ahead and intraday, any language, one or two header lines.

Wall-clock times are used, because the UTC offsets (``2023-01-01T00:00+01:00``) are wrong on some rows of a
year, near the hours at which summer time begins and ends. Without offsets
(``01/01/2021 00:00``) the clock is UTC+1 all year, unless the hour that summer time skips is absent.
"""

import re
from dataclasses import replace
from datetime import timedelta, timezone, tzinfo
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd

from bess.errors import listed
from bess.market.files import Repairs, fail, first_line
from bess.market.numbers import parse_numbers
from bess.market.table import Table
from bess.market.times import by_label, clock_of, have_offsets, localise, parse_times, to_utc
from bess.market.units import check_price_unit
from bess.market.zones import DAY_AHEAD, fail_no_zone, is_zone, wanted_codes, zone_code

PRODUCTS: Final = {
    "ida1": r"\bida\s?1",
    "ida2": r"\bida\s?2",
    "ida3": r"\bida\s?3",
    "id1": r"\bid1\b",
    "id3": r"\bid3\b",
    "exaa": r"\bexaa\b",
    "low": r"intraday.*(\blow|tiefst|niedrigst)",
    "high": r"intraday.*(\bhigh|höchst)",
    "index": r"intraday.*\bindex",
    "average": r"intraday.*(average|durchschnitt|mittel)",
    "auction": r"intraday.*(auction|auktion|enchère|asta|subasta)",
    DAY_AHEAD: r"day[ -]?ahead|vortag",
}
"""Products by name, and how their columns are called, in the order in which they are tried."""
_DEFAULTS: Final = (DAY_AHEAD, "id1", "auction", "average", "index")
"""Without `product` the first of these that the file has."""
_ALIASES: Final = {
    "day-ahead": DAY_AHEAD,
    "dayahead": DAY_AHEAD,
    "intraday_auction": "auction",
    "ida": "auction",
}
_UNIT: Final = re.compile(r"\bMWh?\b")
_PRICE: Final = re.compile(r"/\s*MWh")
_LABEL: Final = re.compile(r"\(([^()]*)\)")
_TIME: Final = re.compile(r"dat(e|um|a)\b|fecha|tag\b", re.IGNORECASE)
_UTC1: Final = timezone(timedelta(hours=1))
_CLOCKS: Final = ("Europe/Berlin", "Europe/Lisbon", "Europe/Helsinki", "UTC")


def matches(table: Table) -> bool:
    """Return whether the header names a product of Energy-Charts, or a line of units follows it."""
    return _has_units(table) or bool(_TIME.match(table.header[0]) and any(map(_product, table.header[1:])))


def read(
    table: Table, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> tuple[pd.DataFrame, tzinfo, str]:
    """Return the prices of a product, their clock and their product.

    By default the product is day-ahead, else ID1, else the intraday auction.
    """
    units = [""] * len(table.header)
    if _has_units(table):
        units = [cell.strip() for cell in table.rows[0]]
        table = replace(table, rows=table.rows[1:], lines=table.lines[1:])
        if not table.rows:
            fail(2, "is the last one: there are headers but no data; fetch the file again")
    column, found = _column(table, zone, product, units)
    check_price_unit(f"{table.header[column]} {units[column]}".replace("EUR/tCO2", ""))
    times, values = parse_times(table.column(0)), parse_numbers(table.column(column))
    if time_zone is not None and not have_offsets(times):
        clock = clock_of(time_zone)
    else:
        clock = _clock(times, repairs)
    return to_utc(times.assign(offset_h=np.nan), values, clock, repairs), clock, found


def _has_units(table: Table) -> bool:
    return not table.rows[0][0].strip() and any(map(_UNIT.search, table.rows[0]))


def _product(header: str) -> str | None:
    lowered = header.casefold()
    return next((name for name, pattern in PRODUCTS.items() if re.search(pattern, lowered)), None)


def _column(table: Table, zone: str, product: str | None, units: list[str]) -> tuple[int, str]:
    """Return the column of the zone and product wanted, and the product's name."""
    products = {i: _product(name) for i, name in enumerate(table.header) if i}
    priced = {
        i: found or "price"
        for i, found in products.items()
        if found or (_PRICE.search(units[i]) and "CO2" not in table.header[i])
    }
    there_are = [f"{table.header[i]} [{found}]" for i, found in priced.items()]
    if not priced:
        fail(1, f"no column of prices among {listed(table.header)}; export prices in EUR/MWh")
    here: dict[int, str] = {}
    for code in wanted_codes(zone):
        here = here or {i: found for i, found in priced.items() if _zone(table.header[i]) == code}
    if not here:
        fail_no_zone(zone, there_are)
    if product is None:
        found = next((name for name in _DEFAULTS if name in here.values()), "price")
    else:
        found = _ALIASES.get(product.casefold(), product.casefold())
    columns = [i for i, name in here.items() if name == found]
    if not columns or (product is None and found == "price" and len(columns) > 1):
        fail(
            1, f"give the product of a column with prices (product={product!r} is none): {listed(there_are)}"
        )
    return max(columns, key=lambda i: sum(bool(row[i].strip()) for row in table.rows)), found


def _zone(header: str) -> str:
    """Return the zone code in the last brackets of a header; Germany by default."""
    return zone_code(["DE-LU", *filter(is_zone, _LABEL.findall(header))][-1])


def _clock(times: pd.DataFrame, repairs: Repairs) -> tzinfo:
    """Return the time zone of the file, by the majority of its offsets or by the hour skipped in spring."""
    wall = pd.DatetimeIndex(times["wall"])
    if not have_offsets(times):
        return ZoneInfo("Europe/Berlin") if _has_summer_time(wall) else _UTC1
    usual = timedelta(hours=float(times["offset_h"].mode()[0]))
    clocks: list[tzinfo] = [*map(ZoneInfo, _CLOCKS), timezone(usual)]
    wrong = [pd.Series(localise(wall, clock) != by_label(times), times.index) for clock in clocks]
    best = min(range(len(clocks)), key=lambda k: int(wrong[k].sum()))
    count, first = int(wrong[best].sum()), first_line(wrong[best])
    if count > max(4, 0.01 * wall.size):
        fail(first, f"{count} UTC offsets fit no clock: mixed time zones; write all times in one zone")
    repairs.add("offset-label", f"corrected UTC offsets that are not those of {clocks[best]}", count, first)
    return clocks[best]


def _has_summer_time(wall: pd.DatetimeIndex) -> bool:
    """Return whether the times follow summer time; False if the file covers no change of the clock."""
    if localise(wall, ZoneInfo("Europe/Berlin")).hasnans:
        return False
    if wall.has_duplicates:
        return True
    spring = [pd.date_range(f"{year}-03-25", f"{year}-03-31", freq="W-SUN")[0] for year in wall.year.unique()]
    return any(wall[0] < day + pd.Timedelta(hours=2) < wall[-1] for day in spring)
