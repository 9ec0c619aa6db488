"""What every price format returns, and what the exports of market platforms have in common."""

from dataclasses import dataclass
from datetime import tzinfo

import numpy as np
import pandas as pd

from bess.market.clock import Rows, ends_day
from bess.market.files import fail, listed
from bess.market.repairs import Repairs
from bess.market.table import Ending, Table
from bess.market.zones import SPLIT, wanted_codes
from bess.numbers import Array


@dataclass(frozen=True)
class Quotes:
    """Prices of one zone and product: rows in UTC [EUR/MWh], and what they are."""

    rows: Rows
    source: str
    zone: str
    product: str


def only_product(path: str, product: str | None, there: str = "day_ahead") -> str:
    """Return the one product of a format; raise InputError if another is wanted."""
    if product not in (None, there):
        fail(path, 1, f"there is no product {product!r} in this file; it holds {there}")
    return there


def join_zone(
    path: str,
    zone: str,
    there: dict[str, Array],
    names: list[str],
    rows: Rows,
    clock: tzinfo,
    repairs: Repairs,
) -> Array:
    """Return the prices of `zone` from those of each zone code; `names` are the zones with any value.

    Until 2018-09-30 Germany and Luxembourg shared a zone with Austria: the series DE-LU takes its prices.
    """
    code, *before = wanted_codes(zone)
    there_are = f"the file has: {listed(names)}"
    codes = [c for c in (code, *before) if c in there]
    if not codes:
        fail(path, 1, f"zone {zone!r} is not in this file; choose another zone or file, {there_are}")
    joined = there.get(code, np.full(rows.utc.size, np.nan)).copy()
    if before and before[0] in there:
        old = (
            np.isnan(joined)
            & np.asarray(rows.utc < pd.Timestamp(SPLIT, tz=clock))
            & ~np.isnan(there[before[0]])
        )
        joined[old] = there[before[0]][old]
        repairs.add(
            "zone-join", f"took {before[0]} until {SPLIT}", int(old.sum()), rows.lines[int(np.argmax(old))]
        )
    if np.isnan(joined).all():
        fail(
            path,
            int(rows.lines[0]),
            f"from here to line {rows.lines[-1]} zone {zone!r} has no value; "
            f"choose another zone or file, {there_are}",
        )
    return joined


def whole_days(rows: Rows, table: Table, clock: tzinfo, repairs: Repairs) -> Rows:
    """Drop the stray rows that an export has after its last day, and refuse one that breaks off.

    Platforms export whole local days. A lone row at midnight, or a few on 1 January, belong to the next
    export. A file that ends within a day and within a line (no line break) was cut off: its last number
    cannot be trusted.
    """
    if table.ending is Ending.CUT:
        fail(
            rows.path,
            int(rows.lines[-1]),
            "ends in the middle of a number: the file is truncated; fetch it again",
        )
    local = rows.utc.tz_convert(clock)
    days = local.normalize()
    last = np.asarray(days == days[-1])
    begins = local[0] == days[0]
    new_year = days[-1].day_of_year == 1 and days[-1].year > days[0].year and not ends_day(rows.utc, clock)
    if begins and last.sum() < last.size and (new_year or (last.sum() == 1 and local[-1] == days[-1])):
        first = int(np.argmax(last))
        repairs.add(
            "stray-rows", "dropped rows after the last whole day", int(last.sum()), int(rows.lines[first])
        )
        return rows.take(~last)
    if not ends_day(rows.utc, clock):
        if table.ending is not Ending.CLEAN and last.sum() < last.size:
            fail(
                rows.path,
                int(rows.lines[-1]),
                f"is the last one, at {local[-1]:%Y-%m-%d %H:%M}, within a day and without a line break: "
                "the file is truncated; fetch it again",
            )
        repairs.add("part-of-a-day", "the last day is not complete", 1, int(rows.lines[-1]))
    return rows
