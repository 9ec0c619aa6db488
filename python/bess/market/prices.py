"""Electricity prices from files of common formats."""

from dataclasses import replace
from datetime import tzinfo
from os import PathLike
from typing import Final

import pandas as pd

from bess.errors import InputError, listed
from bess.files import Fill
from bess.market import energy_charts, entsoe, smard
from bess.market.columns import Columns, parquet_columns, refuse_end, table_columns, without_unit
from bess.market.files import Repairs, fail, reading
from bess.market.regular import regular
from bess.market.table import Ending, Table, read_table
from bess.market.times import ends_day
from bess.market.units import check_price_unit, foreign_unit, is_currency_column, names_euro
from bess.market.zones import fail_no_zone, is_zone, only_day_ahead, zone_code

_AREAS: Final = (
    "PriceArea", "Price Area", "price_area", "Area", "Zone", "Bidding Zone", "bidding_zone", "BiddingZone",
    "BZN", "MapCode", "AreaDisplayName", "DeliveryArea", "Delivery Area", "Country", "ISO3 Code", "region",
)  # fmt: skip
_STRAY_H: Final = 3
"""Rows up to this hour of 1 January after other years are strays; more are a part of the day."""
FORMATS: Final = {"ENTSO-E": entsoe, "SMARD": smard, "Energy-Charts": energy_charts}
"""Formats by source, tried in this order on the content of a table; any other file is a plain table."""


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
        plain table of several columns also the name of a column. Before October 2018 ``DE-LU`` is the zone
        with Austria, if the file contains it.
    product : str, optional
        Needed only for intraday files of Energy-Charts: ``"day_ahead"``, ``"id1"``, ``"id3"``, ``"auction"``,
        ``"ida1"``, ``"index"``, ``"average"``, ``"low"``, ``"high"``. By default day-ahead, else
        ID1, else auction.
    time_zone : str, optional
        Time zone of time stamps without one in plain tables, such as ``"Europe/Berlin"``, ``"UTC"`` or
        ``"UTC+1"``.
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
    A column name with another unit or currency than EUR/MWh is an error; without a unit, EUR/MWh is assumed.

    Repairs, each reported once: a unit that was assumed, the hour that summer time skips and the one it
    repeats, stray rows after the last day, wrong UTC offsets, missing values at the ends (cut), gaps of up to
    an hour (a straight line), a change to a finer step (coarse values are held), another encoding.

    Raises
    ------
    InputError
        The file does not contain such prices; one sentence gives file, line and remedy.
    """
    for name, value in {"zone": zone, "product": product, "time_zone": time_zone}.items():
        if not isinstance(value, str) and (value is not None or name == "zone"):
            raise InputError(f"read_prices: {name} must be a text, not {type(value).__name__}")
    with reading(path) as (raw, repairs):
        rows, source, product = _prices(raw, zone, product, time_zone, repairs)
        series = regular(rows, fill, repairs).rename("price_eur_mwh")
    series.attrs = {
        "units": "EUR/MWh",
        "zone": zone_code(zone),
        "product": product,
        "source": source,
        "repairs": repairs,
    }
    return series


def _prices(
    raw: bytes, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> tuple[pd.DataFrame, str, str]:
    """Return the prices in UTC, their source and their product."""
    if raw[:4] == b"PAR1":
        columns, column = parquet_columns(raw), zone
    else:
        table = read_table(raw, repairs)
        _check_currency(table)
        for source, platform in FORMATS.items():
            if platform.matches(table):
                rows, clock, product = platform.read(table, zone, product, time_zone, repairs)
                return _whole_days(rows, table, clock, repairs), source, product
        columns, column = _of_zone(table, zone, repairs)
    product = only_day_ahead(product)
    column = _column(columns, column)
    check_price_unit(column)
    if not names_euro(column):
        lines = columns.times.index
        repairs.add("assumed-unit", "took prices without a unit as EUR/MWh", lines.size, lines[0])
    return columns.rows(column, time_zone, repairs), "plain", product


def _whole_days(rows: pd.DataFrame, table: Table, clock: tzinfo, repairs: Repairs) -> pd.DataFrame:
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
    last, whole = pd.Series(days == days[-1], rows.index), ends_day(rows["utc"], clock)
    new_year = days[-1].day_of_year == 1 and days[-1].year > days[0].year and local[-1].hour < _STRAY_H
    lone = last.sum() == 1 and local[-1] == days[-1]
    if local[0] == days[0] and not last.all() and (new_year or lone):
        repairs.add_where("stray-rows", "dropped rows after the last whole day", last)
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


def _check_currency(table: Table) -> None:
    """Raise InputError if a currency or unit column names anything but euros per MWh."""
    if table.named("SETTLEMENTDATE") is not None:
        fail(1, "is a table of AEMO with prices in AUD/MWh; convert them to EUR/MWh first")
    for i, name in enumerate(table.header):
        for row, line in zip(table.rows, table.lines, strict=True) if is_currency_column(name) else ():
            cell = row[i].strip()
            if foreign_unit(cell):
                fail(line, f"prices are in {cell} by column {name!r}; convert them to EUR/MWh first")


def _of_zone(table: Table, zone: str, repairs: Repairs) -> tuple[Columns, str]:
    """Take the rows of `zone` out of a table with a column of zones; without one, the table as it is.

    Also returns the zone or column that remains to be found among the columns.
    """
    area = table.named(*_AREAS)
    cells = [] if area is None else list(table.column(area))
    here = [i for i, cell in enumerate(cells) if zone_code(cell) == zone_code(zone)]
    if not cells or not (here or any(map(is_zone, cells))):
        return table_columns(table), zone
    if not here:
        fail_no_zone(zone, sorted(set(cells)))
    priced = [
        name
        for i, name in enumerate(table.header)
        if i != area
        and "price" in name.casefold()
        and not is_currency_column(name)
        and not foreign_unit(name)
    ]
    if len(priced) != 1:
        fail(1, f"which column is the price in EUR/MWh is not clear; keep one of: {listed(table.header)}")
    if here[-1] == len(table.rows) - 1 and table.ending in (Ending.CUT, Ending.OPEN):
        refuse_end(table.lines[-1], table.ending)
    rows, lines = [table.rows[i] for i in here], [table.lines[i] for i in here]
    columns = table_columns(replace(table, rows=rows, lines=lines, ending=Ending.CLEAN))
    if not columns.times["wall"].iloc[0] > columns.times["wall"].iloc[-1]:
        return columns, priced[0]
    repairs.add("descending", "put descending times into ascending order", len(rows), lines[0])
    table = replace(table, rows=rows[::-1], lines=lines[::-1], ending=Ending.CLEAN)
    return table_columns(table), priced[0]


def _column(columns: Columns, zone: str) -> str:
    """Return the only column, or the column of a zone by code or name."""
    plain = {name: without_unit(name) for name in columns.names}
    if len(plain) == 1 and is_zone(zone) and not any(map(is_zone, plain.values())):
        return columns.names[0]
    exact = [name for name, short in plain.items() if zone in (name, short)]
    alike = [name for name, short in plain.items() if zone_code(short) == zone_code(zone)]
    if not exact and not alike:
        there = listed(columns.names)
        fail(1, f"zone {zone!r} is not in this file; give as zone one of its columns: {there}")
    return [*exact, *alike][0]
