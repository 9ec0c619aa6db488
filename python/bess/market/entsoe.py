"""CSV exports of the ENTSO-E Transparency Platform: the old one, and the new one with areas and sequences.

The header names the clock; ``CET`` and ``CET/CEST`` both mean the clock with summer time. The old export has
an empty row for the hour that summer time skips, the new one marks times on these days with ``(CET)`` or
``(CEST)``.
"""

import re
from datetime import tzinfo
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.market.clock import by_label, clock_of, localise, to_utc
from bess.market.files import fail, listed
from bess.market.numbers import parse_numbers
from bess.market.quotes import Quotes, only_product, whole_days
from bess.market.repairs import Repairs
from bess.market.stamps import Stamps, parse_stamps
from bess.market.table import Table
from bess.market.units import check_price_unit
from bess.market.zones import SPLIT, wanted_codes, zone_code
from bess.numbers import Array

Positions = npt.NDArray[np.intp]

_TIME: Final = re.compile(r"(?:MTU|Time)\b\s*(?:\((\w+)[^)]*\))?", re.IGNORECASE)
_PRICE: Final = re.compile(r"day[- ]ahead(?: price)?\s*(?:[\[(]|$)", re.IGNORECASE)
_INTERVAL: Final = re.compile(r"\d\d\d\d \d\d?:\d\d.* - .*\d\d?:\d\d")
_CLOCKS: Final = {"UTC": "UTC", "GMT": "UTC", "WET": "Europe/Lisbon", "EET": "Europe/Helsinki"}


def matches(table: Table) -> bool:
    """Tell whether the first column holds market time units."""
    return bool(_TIME.match(table.header[0]) and _INTERVAL.search(table.rows[0][0]))


def read(table: Table, zone: str, product: str | None, time_zone: str | None, repairs: Repairs) -> Quotes:
    """Return the day-ahead prices of `zone`; of several sequences the first, others only beyond its time."""
    only_product(table.path, product)
    price = next((i for i, name in enumerate(table.header) if _PRICE.match(name)), None)
    if price is None:
        fail(
            table.path,
            1,
            f"no column 'Day-ahead Price' among {listed(table.header)}; export day-ahead prices",
        )
    check_price_unit(table.path, 1, table.header[price])
    head = _TIME.match(table.header[0])
    named = (head[1] or "CET").upper() if head else "CET"
    clock = clock_of(time_zone or _CLOCKS.get(named, "Europe/Brussels"))
    starts = [cell.split(" - ")[0].strip() for cell in table.column(0)]
    stamps = parse_stamps(table.path, table.header[0], starts, table.lines)
    values = parse_numbers(table.path, table.header[price], table.column(price), table.lines)
    which = _of_zone(table, zone, stamps.wall, repairs)
    which = which[_of_sequence(table, which, stamps.wall, values, repairs)]
    which = _in_order(table, which, stamps, clock, repairs)
    lines = [table.lines[i] for i in which]
    rows = to_utc(
        table.path, Stamps(stamps.wall[which], stamps.offset_h[which]), values[which], lines, clock, repairs
    )
    if np.isnan(rows.values).all():
        fail(
            table.path,
            lines[0],
            f"from here to line {lines[-1]} zone {zone!r} has no value; choose another file",
        )
    return Quotes(whole_days(rows, table, clock, repairs), "ENTSO-E", zone_code(zone), "day_ahead")


def _of_zone(table: Table, zone: str, wall: pd.DatetimeIndex, repairs: Repairs) -> Positions:
    """Return the rows of `zone`, before October 2018 those of the zone it came out of, in order of time."""
    area = table.named("Area", "Bidding Zone", "BZN")
    if area is None:
        named = [name for name in table.header if name.startswith("BZN|")]
        names, everything = named, np.arange(wall.size)
        if not named or zone_code(named[0]) in wanted_codes(zone):
            return everything
    else:
        cells = table.column(area)
        names = sorted(set(cells))
        code = {name: zone_code(name) for name in names}
        here = np.array([code[cell] for cell in cells])
        wanted = [c for c in wanted_codes(zone) if c in code.values()]
        if len(wanted) == 2:
            old = wall < pd.Timestamp(SPLIT)
            before, after = (
                np.flatnonzero(old & (here == wanted[1])),
                np.flatnonzero(~old & (here == wanted[0])),
            )
            line = table.lines[before[0]] if before.size else None
            repairs.add("zone-join", f"took {wanted[1]} until {SPLIT}", before.size, line)
            return np.concatenate([before, after])
        if wanted:
            return np.flatnonzero(here == wanted[0])
    there_are = listed(name.removeprefix("BZN|") for name in names)
    fail(
        table.path,
        1,
        f"zone {zone!r} is not in this file; choose another zone or file, the file has: {there_are}",
    )


def _in_order(table: Table, which: Positions, stamps: Stamps, clock: tzinfo, repairs: Repairs) -> Positions:
    """Put the rows of a new export in the order of time; now and then one of them is out of place."""
    utc = localise(stamps.wall[which], clock)
    labelled = stamps.labelled[which]
    marked = pd.DatetimeIndex(by_label(stamps)[which]).tz_localize("UTC")
    utc = pd.DatetimeIndex(np.where(labelled, marked, utc)) if labelled.any() else utc
    back = np.asarray(utc[1:] < utc[:-1])
    if table.named("Area") is None or utc.hasnans or not back.any():
        return which
    order = np.argsort(utc, kind="stable")
    first = table.lines[which[int(np.argmax(back)) + 1]]
    repairs.add("sorted", "put rows that were out of place in the order of time", int(back.sum()), first)
    return which[order]


def _of_sequence(
    table: Table, which: Positions, wall: pd.DatetimeIndex, values: Array, repairs: Repairs
) -> Positions:
    """Return positions in `which`: those of the first sequence, of others only beyond its time."""
    column = table.named("Sequence")
    if column is None:
        return np.arange(which.size)
    cells = np.array([table.rows[i][column].strip() for i in which])
    full = sorted(
        set(cells[~np.isnan(values[which])]), key=lambda name: ("without" not in name.casefold(), name)
    )
    chosen = np.flatnonzero(cells == full[0]) if full else np.arange(which.size)
    times = wall[which]
    for name in full[1:]:
        end = times[chosen[-1]] + (
            times[chosen[-1]] - times[chosen[-2]] if chosen.size > 1 else pd.Timedelta(0)
        )
        beyond = (cells == name) & ((times < times[chosen[0]]) | (times >= end))
        if beyond.any():
            first = table.lines[which[int(np.argmax(beyond))]]
            repairs.add("sequence-join", f"took {name!r} beyond the time of {full[0]!r}", beyond.sum(), first)
            extra = np.flatnonzero(beyond)
            earlier = extra[times[extra] < times[chosen[0]]]
            chosen = np.concatenate([earlier, chosen, np.setdiff1d(extra, earlier)])
    return chosen
