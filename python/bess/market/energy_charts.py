"""Exports of Energy-Charts: day-ahead and intraday, any language, one or two header lines.

With offsets (``2023-01-01T00:00+01:00``) the clock is what it shows: the offsets are wrong on some rows of a
year, near the days and hours at which summer time begins and ends in other months. Without offsets
(``01/01/2021 00:00``) the clock is UTC+1 all year, unless the hour that summer time skips is absent.
"""

import re
from dataclasses import replace
from datetime import timedelta, timezone, tzinfo
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd

from bess.market.clock import by_label, clock_of, localise, skipped, to_utc
from bess.market.files import fail, listed
from bess.market.numbers import parse_numbers
from bess.market.quotes import Quotes, whole_days
from bess.market.repairs import Repairs
from bess.market.stamps import Stamps, parse_stamps
from bess.market.table import Table
from bess.market.units import check_price_unit
from bess.market.zones import is_zone, wanted_codes, zone_code

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
    "day_ahead": r"day[ -]?ahead|vortag",
}
"""Products by name, and how their columns are called, in the order in which they are tried."""
_DEFAULTS: Final = ("day_ahead", "id1", "auction", "average", "index")
"""Without `product` the first of these that the file has."""
_ALIASES: Final = {
    "day-ahead": "day_ahead",
    "dayahead": "day_ahead",
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
    """Tell whether there is a line of units below the header, or a product of Energy-Charts in it."""
    return _has_units(table) or bool(_TIME.match(table.header[0]) and any(map(_product, table.header[1:])))


def read(table: Table, zone: str, product: str | None, time_zone: str | None, repairs: Repairs) -> Quotes:
    """Return the prices of a product: by default day-ahead, else ID1, else the intraday auction."""
    units = [""] * len(table.header)
    if _has_units(table):
        units = [cell.strip() for cell in table.rows[0]]
        table = replace(table, rows=table.rows[1:], lines=table.lines[1:])
        if not table.rows:
            fail(table.path, 2, "is the last one: there are headers but no data; fetch the file again")
    column, found = _column(table, zone, product, units)
    check_price_unit(table.path, 1, f"{table.header[column]} {units[column]}".replace("EUR/tCO2", ""))
    stamps = parse_stamps(table.path, table.header[0], table.column(0), table.lines)
    values = parse_numbers(table.path, table.header[column], table.column(column), table.lines)
    if time_zone is not None and not stamps.labelled.any():
        clock = clock_of(time_zone)
    else:
        clock = _clock(table, stamps, repairs)
    shown = Stamps(stamps.wall, np.full(stamps.wall.size, np.nan))
    rows = to_utc(table.path, shown, values, table.lines, clock, repairs)
    return Quotes(whole_days(rows, table, clock, repairs), "Energy-Charts", zone_code(zone), found)


def _has_units(table: Table) -> bool:
    return not table.rows[0][0].strip() and any(map(_UNIT.search, table.rows[0]))


def _product(header: str) -> str | None:
    lowered = header.casefold()
    return next((name for name, pattern in PRODUCTS.items() if re.search(pattern, lowered)), None)


def _column(table: Table, zone: str, product: str | None, units: list[str]) -> tuple[int, str]:
    """Return the column of the zone and product wanted, and the product's name."""
    priced = {i: _product(name) for i, name in enumerate(table.header) if i}
    priced = {
        i: p or "price"
        for i, p in priced.items()
        if p or (_PRICE.search(units[i]) and "CO2" not in table.header[i])
    }
    there_are = listed(f"{table.header[i]} [{p}]" for i, p in priced.items())
    if not priced:
        fail(table.path, 1, f"no column of prices among {listed(table.header)}; export prices in EUR/MWh")
    labels = {i: [label for label in _LABEL.findall(table.header[i]) if is_zone(label)] for i in priced}
    for code in wanted_codes(zone):
        here = {i: p for i, p in priced.items() if zone_code((labels[i] or ["DE-LU"])[-1]) == code}
        if here:
            break
    else:
        fail(
            table.path,
            1,
            f"zone {zone!r} is not in this file; choose another zone or file, the file has: {there_are}",
        )
    if product is None:
        found = next((p for p in _DEFAULTS if p in here.values()), "price")
    else:
        found = _ALIASES.get(product.casefold(), product.casefold())
    columns = [i for i, p in here.items() if p == found]
    if not columns or (product is None and found == "price" and len(columns) > 1):
        fail(
            table.path,
            1,
            f"give the product of a column with prices (product={product!r} is none): {there_are}",
        )
    return max(columns, key=lambda i: sum(bool(row[i].strip()) for row in table.rows)), found


def _clock(table: Table, stamps: Stamps, repairs: Repairs) -> tzinfo:
    """Return the clock of the file: the one most offsets agree with, or what summer time shows."""
    labelled = stamps.labelled
    if not labelled.any():
        return ZoneInfo("Europe/Berlin") if _has_summer_time(stamps.wall) else _UTC1
    if not labelled.all():
        i = int(np.argmax(labelled != labelled[0]))
        fail(
            table.path,
            table.lines[i],
            f"only one of this time and that of line {table.lines[0]} has a UTC offset: mixed time zones; "
            "write all times alike",
        )
    offset = float(pd.Series(stamps.offset_h).mode()[0])
    clocks: list[tzinfo] = [*map(ZoneInfo, _CLOCKS), timezone(timedelta(hours=offset))]
    labels = pd.DatetimeIndex(by_label(stamps)).tz_localize("UTC")
    wrong = [np.asarray(localise(stamps.wall, clock) != labels) for clock in clocks]
    best = min(range(len(clocks)), key=lambda k: int(wrong[k].sum()))
    count, first = int(wrong[best].sum()), table.lines[int(np.argmax(wrong[best]))]
    if count > max(4, 0.01 * labels.size):
        fail(
            table.path,
            first,
            f"{count} UTC offsets fit no clock: mixed time zones; write all times in one zone",
        )
    repairs.add("offset-label", f"corrected UTC offsets that are not those of {clocks[best]}", count, first)
    return clocks[best]


def _has_summer_time(wall: pd.DatetimeIndex) -> bool:
    """Tell from days of change whether the clock has summer time; False if the file holds none."""
    berlin = ZoneInfo("Europe/Berlin")
    if skipped(wall, berlin).any():
        return False
    if wall.has_duplicates:
        return True
    spring = [pd.date_range(f"{year}-03-25", f"{year}-03-31", freq="W-SUN")[0] for year in wall.year.unique()]
    return any(wall[0] < day + pd.Timedelta(hours=2) < wall[-1] for day in spring)
