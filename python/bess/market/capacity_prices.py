"""Capacity prices of reserve: tender results of regelleistung.net, or a table of times and prices."""

from os import PathLike
from typing import Final

import numpy as np
import pandas as pd

from bess.errors import listed
from bess.market.columns import Columns, parquet_columns, table_columns
from bess.market.files import Repairs, fail, first_line, reading
from bess.market.numbers import parse_numbers
from bess.market.regular import regular
from bess.market.table import Table, read_table
from bess.units import HOURS_PER_DAY

_CLOCK: Final = "Europe/Berlin"
_PRICE: Final = "_SETTLEMENTCAPACITY_PRICE_[EUR/MW]"
_BLOCK: Final = r"^NEGPOS(?:_(\d\d)_(\d\d))?$"
_TENDER: Final = "1"
"""Number of the regular tender of the day before; higher numbers are repeated tenders."""


def read_capacity_prices(
    path: str | PathLike[str], country: str = "GERMANY", *, time_zone: str | None = None
) -> pd.Series:
    """Read the capacity price of reserve per MW and hour.

    Tender results of regelleistung.net (``NEGPOS_00_04`` and the like) give a price for each block of four
    hours of German local time; the block that contains the change to or from summer time has three or five
    hours. The price of a block is paid for the block, so an hour of it earns its share.

    Parameters
    ----------
    path : path
        The file; in a plain table a price holds until the next price, for the whole interval.
    country : str
        As in the columns of tender results; in a plain table of several columns, the name of a column.
    time_zone : str, optional
        Time zone of time stamps without one in a plain table.

    Returns
    -------
    pandas.Series
        Price of a MW for an hour [EUR/MW], hourly, in UTC; ``attrs`` hold ``units``, ``repairs`` and, of
        tender results, ``blocks``: start (UTC) and price [EUR/MW] of each block.

    Raises
    ------
    InputError
        The file does not contain capacity prices; one sentence gives file, line and remedy.
    """
    with reading(path) as (raw, repairs):
        table = None if raw[:4] == b"PAR1" else read_table(raw, repairs)
        if table is not None and table.named("PRODUCTNAME") is not None:
            series = _tenders(table, country, repairs)
        else:
            columns = parquet_columns(raw) if table is None else table_columns(table)
            series = _plain(columns, country, time_zone, repairs)
    series.attrs |= {"units": "EUR/MW/h", "repairs": repairs}
    return series


def _tenders(table: Table, country: str, repairs: Repairs) -> pd.Series:
    column = table.named(f"{country}{_PRICE}")
    if column is None:
        known = [title.removesuffix(_PRICE) for title in table.header if title.endswith(_PRICE)]
        fail(1, f"there is no price of {str(country)!r}; give one of: {listed(known)}")
    tender = table.named("TENDER_NUMBER")
    wanted = pd.Series(True, table.lines) if tender is None else table.column(tender) == _TENDER
    if not wanted.any():
        fail(
            table.lines[0], "begins a file of repeated tenders only; fetch the results of the regular tender"
        )
    repairs.add("other-tenders", "left out rows of repeated tenders", (~wanted).sum())
    blocks = _spans(table, wanted).assign(price=parse_numbers(table.column(column)[wanted], ","))
    blocks = blocks.sort_values("start", kind="stable")
    if (line := first_line(blocks["price"].isna())) is not None:
        fail(line, "the block has no price; complete the file")
    end = (blocks["start"] + pd.to_timedelta(blocks["hours"], unit="h")).shift()
    if (line := first_line(end.notna() & (blocks["start"] != end))) is not None:
        gap = f"follows a gap from {end[line]:%Y-%m-%d %H:%M} UTC"
        what = "overlaps the block before it" if blocks["start"][line] < end[line] else gap
        fail(line, f"the block {what}; give each block once, without gaps")
    hourly = (blocks["price"] / blocks["hours"]).to_numpy().repeat(blocks["hours"])
    index = pd.date_range(blocks["start"].iloc[0], periods=hourly.size, freq="h", name="time")
    series = pd.Series(hourly, index, name="capacity_price_eur_mw_h")
    series.attrs["blocks"] = pd.Series(blocks["price"].to_numpy(), pd.DatetimeIndex(blocks["start"].array))
    return series


def _spans(table: Table, wanted: pd.Series) -> pd.DataFrame:
    """Return the start (UTC) and length [h] of each block."""
    product, date = table.named("PRODUCTNAME"), table.named("DATE_FROM")
    if date is None or product is None:
        fail(1, "there is no column DATE_FROM; fetch the file again")
    dates, products = table.column(date)[wanted], table.column(product)[wanted]
    days = pd.to_datetime(dates, format="%d.%m.%Y", errors="coerce")
    if (line := first_line(days.isna())) is not None:
        fail(line, f"the date {dates[line]!r} is not written as 31.01.2024; correct the row")
    hours = products.str.extract(_BLOCK).fillna({0: "0", 1: "24"}).astype(int)
    start, end = (
        (days + pd.to_timedelta(hours[i], unit="h"))
        .dt.tz_localize(_CLOCK, ambiguous=np.ones(days.size, bool), nonexistent="shift_forward")
        .dt.tz_convert("UTC")
        for i in (0, 1)
    )
    length_h = ((end - start) / pd.Timedelta(hours=1)).round().astype(int)
    if (line := first_line(~products.str.match(_BLOCK) | (length_h < 1))) is not None:
        fail(line, f"the product {products[line]!r} is none of NEGPOS_00_04 and so on; leave it out")
    return pd.DataFrame({"start": start, "hours": length_h})


def _plain(columns: Columns, country: str, time_zone: str | None, repairs: Repairs) -> pd.Series:
    chosen = columns.choose(country if len(columns.names) > 1 else None, "price of capacity")
    series = regular(columns.rows(chosen, time_zone, repairs), None, repairs, max_step_h=HOURS_PER_DAY)
    hours, rest = divmod(series.index[1] - series.index[0], pd.Timedelta(hours=1))
    if not hours or rest:
        minutes = (series.index[1] - series.index[0]) / pd.Timedelta(minutes=1)
        fail(None, f"prices of capacity every {minutes:g} min; give whole hours, such as blocks of four")
    index = pd.date_range(series.index[0], periods=series.size * hours, freq="h", name="time")
    return pd.Series(series.to_numpy().repeat(hours) / hours, index, name="capacity_price_eur_mw_h")
