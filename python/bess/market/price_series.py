"""The common result of all price formats, and checks shared by the exports of market platforms."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import tzinfo
from typing import Final, NoReturn

import numpy as np
import pandas as pd

from bess.market.files import fail, first_line, listed
from bess.market.repairs import Repairs
from bess.market.table import Ending, Table
from bess.market.times import ends_day

DAY_AHEAD: Final = "day_ahead"


@dataclass(frozen=True)
class PriceSeries:
    """Prices of one zone and product: rows in UTC [EUR/MWh] with their description."""

    rows: pd.DataFrame
    source: str
    product: str = DAY_AHEAD


def only_day_ahead(product: str | None) -> None:
    """Raise InputError for products other than day-ahead, for formats that hold day-ahead prices only."""
    if product not in (None, DAY_AHEAD):
        fail(1, f"there is no product {product!r} in this file; it holds {DAY_AHEAD}")


def fail_no_zone(zone: str, names: Iterable[str]) -> NoReturn:
    """Raise an InputError for a zone that the file does not contain."""
    fail(1, f"zone {zone!r} is not in this file; choose another zone or file, the file has: {listed(names)}")


def check_values(zone: str, values: pd.Series, names: Iterable[str]) -> None:
    """Raise InputError if the prices of a zone are all missing; `names` are the zones of the file."""
    if values.isna().all():
        fail(
            values.index[0],
            f"from here to line {values.index[-1]} zone {zone!r} has no value; "
            f"choose another zone or file, the file has: {listed(names)}",
        )


def whole_days(rows: pd.DataFrame, table: Table, clock: tzinfo, repairs: Repairs) -> pd.DataFrame:
    """Drop the stray rows that an export has after its last day, and refuse one that breaks off.

    Platforms export whole local days. A lone row at midnight, or a few on 1 January, belong to the next
    export. A file that ends within a day and within a line (no line break) was cut off: its last number
    cannot be trusted.
    """
    end = rows.index[-1]
    if table.ending is Ending.CUT:
        fail(end, "ends in the middle of a number: the file is truncated; fetch it again")
    local = pd.DatetimeIndex(rows["utc"]).tz_convert(clock)
    days = local.normalize()
    last, whole = np.asarray(days == days[-1]), ends_day(rows["utc"], clock)
    new_year = days[-1].day_of_year == 1 and days[-1].year > days[0].year and not whole
    lone = last.sum() == 1 and local[-1] == days[-1]
    if local[0] == days[0] and not last.all() and (new_year or lone):
        text = "dropped rows after the last whole day"
        repairs.add("stray-rows", text, last.sum(), first_line(pd.Series(last, rows.index)))
        return rows[~last]
    if not whole:
        if table.ending is not Ending.CLEAN and not last.all():
            fail(
                end,
                f"is the last one, at {local[-1]:%Y-%m-%d %H:%M}, within a day and without a line break: "
                "the file is truncated; fetch it again",
            )
        repairs.add("part-of-a-day", "the last day is not complete", 1, end)
    return rows
