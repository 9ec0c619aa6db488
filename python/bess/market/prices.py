"""Electricity prices from the files that people have."""

from os import PathLike, fspath
from typing import Final

import pandas as pd

from bess.market import energy_charts, entsoe, smard
from bess.market.columns import Columns, csv_columns, read_columns
from bess.market.files import fail, read_bytes
from bess.market.quotes import Quotes, check_unit, only_product
from bess.market.regular import Fill, regular
from bess.market.repairs import Repairs
from bess.market.table import read_table
from bess.market.zones import is_zone, zone_code

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
    Repairs, each reported once: the hour that summer time skips and the one it repeats, stray rows after the
    last day, wrong UTC offsets, missing values at the ends (cut), gaps of up to an hour (a straight line), a
    change to a finer step (coarse values are held), another encoding.

    Raises
    ------
    InputError
        The file cannot be read as prices; one sentence names file, line and remedy.
    """
    name = fspath(path)
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
    for matches, read in FORMATS:
        if matches(table):
            return read(table, zone, product, time_zone, repairs)
    return _plain(csv_columns(table), zone, product, time_zone, repairs)


def _plain(
    columns: Columns, zone: str, product: str | None, time_zone: str | None, repairs: Repairs
) -> Quotes:
    named = {name: zone_code(name) for name in columns.names}
    if len(columns.names) == 1 and not is_zone(columns.names[0]):
        column = columns.names[0]
    else:
        column = next((name for name, code in named.items() if code == zone_code(zone)), "")
    if not column:
        listed = ", ".join(columns.names) or "(none)"
        fail(columns.path, 1, f"zone {zone!r} is not in this file; give as zone one of its columns: {listed}")
    check_unit(columns.path, 1, column)
    only_product(columns.path, product)
    return Quotes(columns.rows(column, time_zone, repairs), "plain", zone_code(zone), "day_ahead")
