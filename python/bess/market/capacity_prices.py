"""Prices of reserve by blocks: tender results of regelleistung.net, or a table of times and prices."""

import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from os import PathLike
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd

from bess.errors import InputError
from bess.market.columns import csv_columns
from bess.market.files import fail, listed, path_text, read_bytes
from bess.market.numbers import parse_numbers
from bess.market.regular import regular
from bess.market.repairs import Repairs
from bess.market.sources import read_table
from bess.market.table import Table

_CLOCK: Final = ZoneInfo("Europe/Berlin")
_PRICE: Final = "_SETTLEMENTCAPACITY_PRICE_[EUR/MW]"
_BLOCK: Final = re.compile(r"NEGPOS(?:_(\d\d)_(\d\d))?")
_TENDER: Final = "1"
"""The tender of the day before; others procure again what failed."""
_DAY_S: Final = 86_400


def read_capacity_prices(
    path: str | PathLike[str], country: str = "GERMANY", *, time_zone: str | None = None
) -> pd.Series:
    """Read what a MW of reserve earns in each hour.

    Tender results of regelleistung.net (``NEGPOS_00_04`` and the like) give a price for each block of four
    hours of the German clock; on the days on which that changes, the block over the change has three or
    five hours. The price of a block is paid for the block, so an hour of it earns its share.

    Parameters
    ----------
    path : path
        The file; in a plain table a price holds until the next, and is that of the time in between.
    country : str
        As in the columns of tender results; in a plain table of several columns, the name of a column.
    time_zone : str, optional
        Clock of times without one in a plain table.

    Returns
    -------
    pandas.Series
        Price of a MW for an hour [EUR/MW], hourly, in UTC; ``attrs`` hold ``units``, ``repairs`` and, of
        tender results, ``blocks``: start (UTC) and price [EUR/MW] of each block.

    Raises
    ------
    InputError
        The file cannot be read as such; one sentence names file, line and remedy.
    """
    name = path_text(path)
    repairs = Repairs()
    table = read_table(name, read_bytes(path), repairs)
    if table.named("PRODUCTNAME") is None:
        series = _plain(table, country, time_zone, repairs)
    else:
        series = _tenders(table, country, repairs)
    series.attrs |= {"units": "EUR/MW/h", "repairs": repairs}
    repairs.report(name)
    return series


def _tenders(table: Table, country: str, repairs: Repairs) -> pd.Series:
    index = {title: place for place, title in enumerate(table.header)}
    column = next(
        (i for title, i in index.items() if title.casefold() == (country + _PRICE).casefold()), None
    )
    if column is None:
        known = [title.removesuffix(_PRICE) for title in index if title.endswith(_PRICE)]
        fail(table.path, 1, f"there is no price of {country!r}; give one of: {listed(known)}")
    numbers = table.named("TENDER_NUMBER")
    keep = [numbers is None or row[numbers].strip() == _TENDER for row in table.rows]
    repairs.add("other-tenders", "left out rows of repeated tenders", len(keep) - sum(keep))
    rows = [row for row, wanted in zip(table.rows, keep, strict=True) if wanted]
    lines = [line for line, wanted in zip(table.lines, keep, strict=True) if wanted]
    prices = parse_numbers(table.path, table.header[column], [row[column] for row in rows], lines, ",")
    spans = list(_spans(table, rows, lines))
    order = sorted(range(len(spans)), key=lambda place: spans[place][0])
    starts, hours, values, blocks = [], [], [], {}
    end = None
    for place in order:
        start, length_h = spans[place]
        if np.isnan(prices[place]):
            fail(table.path, lines[place], "the block has no price; complete the file")
        if end is not None and start != end:
            what = (
                "overlaps the block before it"
                if start < end
                else f"follows a gap from {end:%Y-%m-%d %H:%M} UTC"
            )
            fail(table.path, lines[place], f"the block {what}; give each block once, without gaps")
        end = start + timedelta(hours=length_h)
        starts.append(start)
        hours.append(length_h)
        values.append(float(prices[place]))
        blocks[pd.Timestamp(start)] = float(prices[place])
    hourly = np.repeat(np.array(values) / np.array(hours), hours)
    series = pd.Series(hourly, pd.date_range(starts[0], periods=hourly.size, freq="h", name="time"))
    series.attrs["blocks"] = pd.Series(blocks)
    return series.rename("capacity_price_eur_mw_h")


def _spans(table: Table, rows: list[list[str]], lines: list[int]) -> Iterator[tuple[datetime, int]]:
    """Start (UTC) and length [h] of each block."""
    product, date = table.named("PRODUCTNAME"), table.named("DATE_FROM")
    if date is None or product is None:
        fail(table.path, 1, "there is no column DATE_FROM; fetch the file again")
    for row, line in zip(rows, lines, strict=True):
        block = _BLOCK.fullmatch(row[product].strip())
        try:
            day = datetime.strptime(row[date].strip(), "%d.%m.%Y")
        except ValueError:
            fail(table.path, line, f"the date {row[date]!r} is not written as 31.01.2024; correct the row")
        if block is None:
            fail(
                table.path,
                line,
                f"the product {row[product]!r} is none of NEGPOS_00_04 and so on; leave it out",
            )
        first, last = (int(block[1]), int(block[2])) if block[1] else (0, 24)
        start, end = (
            (day + timedelta(hours=hour)).replace(tzinfo=_CLOCK).astimezone(ZoneInfo("UTC"))
            for hour in (first, last)
        )
        yield start, round((end - start).total_seconds() / 3600.0)


def _plain(table: Table, country: str, time_zone: str | None, repairs: Repairs) -> pd.Series:
    columns = csv_columns(table)
    chosen = columns.choose(country if len(columns.names) > 1 else None, "price of capacity")
    rows = columns.rows(chosen, time_zone, repairs)
    series = regular(rows, None, repairs, longest_step_s=_DAY_S)
    hours = (series.index[1] - series.index[0]) / pd.Timedelta(hours=1)
    if hours < 1.0:
        raise InputError(
            f"{table.path}: prices of capacity every {60 * hours:g} min; give hours or longer blocks"
        )
    index = pd.date_range(series.index[0], periods=round(series.size * hours), freq="h", name="time")
    return pd.Series(series.to_numpy().repeat(round(hours)) / hours, index, name="capacity_price_eur_mw_h")
