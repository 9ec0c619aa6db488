"""CSV exports of the ENTSO-E Transparency Platform: the old one, and the new one with areas and sequences.

The header names the clock; ``CET`` and ``CET/CEST`` both mean the clock with summer time. The old export has
an empty row for the hour that summer time skips, the new one marks times on these days with ``(CET)`` or
``(CEST)``.
"""

import re
from datetime import tzinfo
from typing import Final

import pandas as pd

from bess.errors import listed
from bess.market.columns import named_clock
from bess.market.files import Repairs, fail
from bess.market.numbers import parse_numbers
from bess.market.table import Table
from bess.market.times import clock_of, in_utc, parse_times, to_utc
from bess.market.units import check_price_unit
from bess.market.zones import (
    SPLIT,
    check_known,
    check_values,
    fail_no_zone,
    only_day_ahead,
    wanted_codes,
    zone_code,
)

_TIME: Final = re.compile(r"(?:MTU|Time)\b", re.IGNORECASE)
_PRICE: Final = re.compile(r"day[- ]ahead(?: price)?\s*(?:[\[(]|$)", re.IGNORECASE)
_INTERVAL: Final = re.compile(r"\d\d\d\d \d\d?:\d\d.* - .*\d\d?:\d\d")


def matches(table: Table) -> bool:
    """Return whether the first column holds market time units."""
    return bool(_TIME.match(table.header[0]) and _INTERVAL.search(table.rows[0][0]))


def read(
    table: Table, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> tuple[pd.DataFrame, tzinfo, str]:
    """Return the day-ahead prices of `zone`, their clock and their product.

    Of several sequences the first counts, others only beyond its time.
    """
    product = only_day_ahead(product)
    price = next((i for i, name in enumerate(table.header) if _PRICE.match(name)), None)
    if price is None:
        there = listed(table.header)
        fail(1, f"no column 'Day-ahead Price' among {there}; export day-ahead prices")
    check_price_unit(table.header[price])
    clock = clock_of(time_zone or named_clock(table.header[0]) or "Europe/Brussels")
    starts = table.column(0).str.partition(" - ")[0].str.strip().rename(table.header[0])
    prices = parse_times(starts).assign(value=parse_numbers(table.column(price)))
    prices = _of_sequence(table, _of_zone(table, zone, prices, repairs), repairs)
    if table.named("Area") is not None:
        prices = _in_order(prices, clock, repairs)
    rows = to_utc(prices, prices["value"], clock, repairs)
    check_values(zone, rows["value"], [zone])
    return rows, clock, product


def _of_zone(table: Table, zone: str, prices: pd.DataFrame, repairs: Repairs) -> pd.DataFrame:
    """Return the rows of `zone`, before October 2018 those of its predecessor."""
    area = table.named("Area", "Bidding Zone", "BZN")
    if area is None:
        names = [name for name in table.header if name.startswith("BZN|")]
        if not names:
            check_known(zone)
        if not names or zone_code(names[0]) in wanted_codes(zone):
            return prices
    else:
        names = sorted(set(table.column(area)))
        code = table.column(area).map({name: zone_code(name) for name in names})
        there = [wanted for wanted in wanted_codes(zone) if (code == wanted).any()]
        if len(there) == 2:
            old = prices["wall"] < SPLIT
            before = old & (code == there[1])
            repairs.add_where("zone-join", f"took {there[1]} until {SPLIT}", before)
            return pd.concat([prices[before], prices[~old & (code == there[0])]])
        if there:
            return prices[code == there[0]]
    fail_no_zone(zone, (name.removeprefix("BZN|") for name in names))


def _of_sequence(table: Table, prices: pd.DataFrame, repairs: Repairs) -> pd.DataFrame:
    """Return the prices of the first sequence, extended by other sequences beyond its end."""
    column = table.named("Sequence")
    if column is None:
        return prices
    cells = table.column(column)[prices.index]
    names = set(cells[prices["value"].notna()])
    first, *others = sorted(names, key=lambda name: ("without" not in name.casefold(), name)) or [None]
    chosen = prices if first is None else prices[cells == first]
    for name in others:
        other, wall = prices[cells == name], chosen["wall"]
        end = wall.iloc[-1] + (wall.iloc[-1] - wall.iloc[-2] if wall.size > 1 else pd.Timedelta(0))
        before, after = other[other["wall"] < wall.iloc[0]], other[other["wall"] >= end]
        beyond = pd.concat([before, after])
        text = f"took {name!r} beyond the time of {first!r}"
        repairs.add("sequence-join", text, len(beyond), min(beyond.index, default=None))
        chosen = pd.concat([before, chosen, after])
    return chosen


def _in_order(prices: pd.DataFrame, clock: tzinfo, repairs: Repairs) -> pd.DataFrame:
    """Sort the rows of a new export by time; single rows can be out of order."""
    utc = pd.Series(in_utc(prices, clock), prices.index)
    back = utc.diff() < pd.Timedelta(0)
    if utc.hasnans or not back.any():
        return prices
    repairs.add_where("sorted", "put rows that were out of place in the order of time", back)
    return prices.loc[utc.sort_values(kind="stable").index]
