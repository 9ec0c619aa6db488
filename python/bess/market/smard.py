"""Exports of SMARD, the platform of the German regulator: German and English, old and new layout.

Clock: Europe/Berlin, without a mark for the repeated hour. The end of the interval is not read: in spring it
is wrong by a day.
"""

import re
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from bess.market.clock import clock_of, to_utc
from bess.market.files import fail, listed
from bess.market.numbers import MISSING, parse_numbers
from bess.market.quotes import Quotes, join_zone, only_product, whole_days
from bess.market.repairs import Repairs
from bess.market.stamps import Stamps, parse_stamps
from bess.market.table import Table
from bess.market.units import check_price_unit
from bess.market.zones import wanted_codes, zone_code
from bess.numbers import Array

_PRICE: Final = re.compile(r"(.*?)\s*\[([^\]]*)/MWh\]")
_BOTH: Final = ("Datum von", "Start date", "Beginn")
_DAY: Final = ("Datum", "Date")
_CLOCK: Final = ("Uhrzeit", "Time of day", "Anfang", "Start", "Von", "Start time")
_END: Final = ("Datum bis", "End date")


def matches(table: Table) -> bool:
    """Tell whether the header is one of SMARD's tables of prices."""
    return table.named(*_BOTH, *_DAY) is not None and any(map(_PRICE.match, table.header))


def read(table: Table, zone: str, product: str | None, time_zone: str | None, repairs: Repairs) -> Quotes:
    """Return the day-ahead prices of `zone`."""
    only_product(table.path, product)
    stamps = _stamps(table)
    clock = clock_of(time_zone or "Europe/Berlin")
    names, there = _zones(table, zone)
    rows = to_utc(
        table.path, stamps, np.arange(stamps.wall.size, dtype=np.float64), table.lines, clock, repairs
    )
    kept = rows.values.astype(np.intp)
    there = {code: values[kept] for code, values in there.items()}
    values = join_zone(table.path, zone, there, names, rows, clock, repairs)
    rows = whole_days(replace(rows, values=values), table, clock, repairs)
    return Quotes(rows, "SMARD", zone_code(zone), "day_ahead")


def _stamps(table: Table) -> Stamps:
    both = table.named(*_BOTH)
    if both is not None:
        end = table.named(*_END)
        stamps = parse_stamps(table.path, table.header[both], table.column(both), table.lines)
        if end is not None:
            first = parse_stamps(table.path, table.header[end], table.column(end)[:1], table.lines)
            if first.wall[0] < stamps.wall[0]:
                names = f"{table.header[both]!r} and {table.header[end]!r}"
                text = f"columns {names} are swapped: the interval ends before it begins; swap them back"
                fail(table.path, table.lines[0], text)
        return stamps
    day, clock = table.named(*_DAY), table.named(*_CLOCK)
    if day is None or clock is None:
        fail(
            table.path,
            1,
            f"no column for the time of day among {listed(table.header)}; export the table again",
        )
    cells = [f"{row[day].strip()} {row[clock].strip()}" for row in table.rows]
    return parse_stamps(table.path, f"{table.header[day]} + {table.header[clock]}", cells, table.lines)


def _zones(table: Table, zone: str) -> tuple[list[str], dict[str, Array]]:
    """Return the names of zones with any value, and the prices of those wanted (others are not parsed)."""
    wanted = wanted_codes(zone)
    decimal: Literal[",", "."] = "," if table.named("Datum von", "Datum") is not None else "."
    names: list[str] = []
    there: dict[str, Array] = {}
    for i, header in enumerate(table.header):
        match = _PRICE.match(header)
        if not match:
            continue
        if any(row[i].strip().lower() not in MISSING for row in table.rows):
            names.append(match[1])
        code = zone_code(match[1])
        if code in wanted:
            check_price_unit(table.path, 1, header)
            values = parse_numbers(table.path, header, table.column(i), table.lines, decimal)
            if code not in there or np.isnan(there[code]).sum() > np.isnan(values).sum():
                there[code] = values
    return names, there
