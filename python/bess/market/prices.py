"""Electricity prices from the files that people have."""

import re
from dataclasses import replace
from os import PathLike
from typing import Final

import pandas as pd

from bess.files import Fill
from bess.market import energy_charts, entsoe, smard
from bess.market.columns import Columns, csv_columns, read_columns
from bess.market.files import fail, listed, path_text, read_bytes
from bess.market.quotes import Quotes, only_product
from bess.market.regular import regular
from bess.market.repairs import Repairs
from bess.market.sources import read_table
from bess.market.table import Ending, Table
from bess.market.units import check_price_unit, foreign_unit, is_currency_column, says_euro
from bess.market.zones import is_zone, zone_code

_AREAS: Final = (
    "PriceArea", "Price Area", "price_area", "Area", "Zone", "Bidding Zone", "bidding_zone", "BiddingZone",
    "BZN", "MapCode", "AreaDisplayName", "DeliveryArea", "Delivery Area", "Country", "ISO3 Code", "region",
)  # fmt: skip
_UNIT: Final = re.compile(r"\s*[\[(].*?[\])]")
FORMATS: Final = (
    (entsoe.matches, entsoe.read),
    (smard.matches, smard.read),
    (energy_charts.matches, energy_charts.read),
)
"""Formats tried in this order on the content of a CSV file; what none of them matches is a plain table."""


def read_prices(
    path: str | PathLike[str],
    zone: str = "DE-LU",
    product: str | None = None,
    *,
    time_zone: str | None = None,
    fill: Fill | None = None,
) -> pd.Series:
    """Read market prices as a series in UTC without gaps.

    The format is found from the content: exports of SMARD, of Energy-Charts and of the ENTSO-E Transparency
    Platform, old and new; a plain CSV table; Parquet; any of them in a gzip or zip archive.

    Parameters
    ----------
    path : path
        The file.
    zone : str
        Bidding zone by code or name: ``"DE-LU"``, ``"DE/LU"``, ``"Germany/Luxembourg"``, ``"BZN|PT"``; in a
        plain table of several columns also the name of a column. ``DE-LU`` is continued before October 2018
        by the zone with Austria if the file holds it.
    product : str, optional
        Needed only for intraday files of Energy-Charts: ``"day_ahead"``, ``"id1"``, ``"id3"``, ``"auction"``,
        ``"ida1"``, ``"index"``, ``"average"``, ``"low"``, ``"high"``. By default day-ahead, else
        ID1, else auction.
    time_zone : str, optional
        Clock of times without one in plain tables, such as ``"Europe/Berlin"``, ``"UTC"`` or ``"UTC+1"``.
        Exports are read with the clock of their platform unless it is given.
    fill : {"previous", "interpolate", "previous_day"}, optional
        How to fill gaps longer than an hour, which are an error otherwise.

    Returns
    -------
    pandas.Series
        Prices [EUR/MWh], each for the interval from its label (UTC) to the next; ``attrs`` hold ``units``,
        ``zone``, ``product``, ``source`` and ``repairs`` (:class:`bess.market.Repairs`).

    Notes
    -----
    The name of a column must not say another unit or currency than EUR/MWh; one that says none is taken so.

    Repairs, each reported once: a unit that was assumed, the hour that summer time skips and the one it
    repeats, stray rows after the last day, wrong UTC offsets, missing values at the ends (cut), gaps of up to
    an hour (a straight line), a change to a finer step (coarse values are held), another encoding.

    Raises
    ------
    InputError
        The file cannot be read as prices; one sentence names file, line and remedy.
    """
    name = path_text(path)
    repairs = Repairs()
    quotes = _quotes(name, read_bytes(path), zone, product, time_zone, repairs)
    series = regular(quotes.rows, fill, repairs).rename("price_eur_mwh")
    series.attrs = {
        "units": "EUR/MWh",
        "zone": quotes.zone,
        "product": quotes.product,
        "source": quotes.source,
        "repairs": repairs,
    }
    repairs.report(name)
    return series


def _quotes(
    path: str, raw: bytes, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> Quotes:
    if raw[:4] == b"PAR1":
        return _plain(read_columns(path, raw, repairs), zone, product, time_zone, repairs)
    table = read_table(path, raw, repairs)
    _check_currency(table)
    for matches, read in FORMATS:
        if matches(table):
            return read(table, zone, product, time_zone, repairs)
    table, column = _rows_of_zone(table, zone, repairs)
    return _plain(csv_columns(table), column, product, time_zone, repairs)


def _check_currency(table: Table) -> None:
    """Refuse prices beside which a column says another currency or unit."""
    if table.named("SETTLEMENTDATE") is not None:
        fail(table.path, 1, "is a table of AEMO with prices in AUD/MWh; convert them to EUR/MWh first")
    for i, name in enumerate(table.header):
        for cell, line in zip(table.column(i), table.lines, strict=True) if is_currency_column(name) else ():
            if foreign_unit(cell):
                text = f"prices are in {cell} by column {name!r}; convert them to EUR/MWh first"
                fail(table.path, line, text)


def _rows_of_zone(table: Table, zone: str, repairs: Repairs) -> tuple[Table, str]:
    """Take the rows of `zone` out of a table with a column of zones; without one, the table as it is.

    Also returns the zone that remains to be found among the columns.
    """
    area = table.named(*_AREAS)
    cells = [] if area is None else table.column(area)
    here = [i for i, cell in enumerate(cells) if zone_code(cell) == zone_code(zone)]
    if not cells or not (here or any(map(is_zone, cells))):
        return table, zone
    if not here:
        there_are = listed(sorted(set(cells)))
        fail(table.path, 1, f"zone {zone!r} is not in this file; choose another, the file has: {there_are}")
    priced = [
        i
        for i, name in enumerate(table.header)
        if i != area
        and "price" in name.casefold()
        and not is_currency_column(name)
        and not foreign_unit(name)
    ]
    if len(priced) != 1:
        names = listed(table.header)
        fail(table.path, 1, f"which column is the price in EUR/MWh is not clear; keep one of: {names}")
    if here[-1] == len(table.rows) - 1 and table.ending in (Ending.CUT, Ending.OPEN):
        text = f"the file ends {table.ending.value}, so it may be truncated"
        fail(
            table.path,
            table.lines[-1],
            f"{text}; fetch it again, or end it with a line break if it is complete",
        )
    rows, lines = [table.rows[i] for i in here], [table.lines[i] for i in here]
    stamps = csv_columns(replace(table, rows=rows, lines=lines)).stamps.wall
    if stamps.size > 1 and stamps[0] > stamps[-1]:
        repairs.add("descending", "put descending times into ascending order", len(rows), lines[0])
        rows, lines = rows[::-1], lines[::-1]
    return replace(table, rows=rows, lines=lines, ending=Ending.CLEAN), table.header[priced[0]]


def _plain(
    columns: Columns, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> Quotes:
    plain = {name: _UNIT.sub("", name) for name in columns.names}
    if len(columns.names) == 1 and not is_zone(plain[columns.names[0]]):
        column = columns.names[0]
    else:
        exact = (name for name, short in plain.items() if zone in (name, short))
        alike = (name for name, short in plain.items() if zone_code(short) == zone_code(zone))
        column = next(exact, "") or next(alike, "")
    if not column:
        there_are = listed(columns.names)
        fail(
            columns.path,
            1,
            f"zone {zone!r} is not in this file; give as zone one of its columns: {there_are}",
        )
    check_price_unit(columns.path, 1, column)
    if not says_euro(column):
        repairs.add(
            "assumed-unit",
            "took prices without a unit as EUR/MWh",
            columns.stamps.wall.size,
            columns.lines[0],
        )
    only_product(columns.path, product)
    return Quotes(columns.rows(column, time_zone, repairs), "plain", zone_code(zone), "day_ahead")
