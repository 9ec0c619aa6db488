"""Bidding zones and products: their names, and errors for those that a file does not hold."""

import re
import unicodedata
from collections.abc import Iterable
from typing import Final, NoReturn

import pandas as pd

from bess.errors import listed
from bess.market.files import fail

DAY_AHEAD: Final = "day_ahead"

_NAMES: Final = {
    "DE-LU": "DE/LU, DE, Germany, Deutschland, Germany/Luxembourg, Deutschland/Luxemburg, "
    "Allemagne/Luxembourg, Germania/Lussemburgo, Alemania/Luxemburgo, 10Y1001A1001A82H",
    "DE-AT-LU": "Germany/Austria/Luxembourg, Deutschland/Österreich/Luxemburg, 10Y1001A1001A63L",
    "AT": "Austria, Österreich, 10YAT-APG------L",
    "BE": "Belgium, Belgien, 10YBE----------2",
    "BG": "Bulgaria, Bulgarien",
    "CH": "Switzerland, Schweiz, 10YCH-SWISSGRIDZ",
    "CZ": "Czech Republic, Czechia, Tschechien, 10YCZ-CEPS-----N",
    "DK1": "Denmark 1, Dänemark 1, DK-1, 10YDK-1--------W",
    "DK2": "Denmark 2, Dänemark 2, DK-2, 10YDK-2--------M",
    "EE": "Estonia, Estland",
    "ES": "Spain, Spanien, 10YES-REE------0",
    "FI": "Finland, Finnland, 10YFI-1--------U",
    "FR": "France, Frankreich, 10YFR-RTE------C",
    "GR": "Greece, Griechenland",
    "HR": "Croatia, Kroatien",
    "HU": "Hungary, Ungarn",
    "IT-North": "Northern Italy, Italy (North), Italien (Nord), IT-Nord, IT-NORTH",
    "LT": "Lithuania, Litauen",
    "LV": "Latvia, Lettland",
    "NL": "Netherlands, Niederlande, 10YNL----------L",
    "NO1": "Norway 1, Norwegen 1",
    "NO2": "Norway 2, Norwegen 2",
    "NO3": "Norway 3, Norwegen 3",
    "NO4": "Norway 4, Norwegen 4",
    "NO5": "Norway 5, Norwegen 5",
    "PL": "Poland, Polen, 10YPL-AREA-----S",
    "PT": "Portugal, 10YPT-REN------W",
    "RO": "Romania, Rumänien",
    "SE1": "Sweden 1, Schweden 1",
    "SE2": "Sweden 2, Schweden 2",
    "SE3": "Sweden 3, Schweden 3",
    "SE4": "Sweden 4, Schweden 4",
    "SI": "Slovenia, Slowenien",
    "SK": "Slovakia, Slowakei",
}
SPLIT: Final = "2018-10-01"
"""From this local day on Germany and Luxembourg have a zone without Austria."""


def _key(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name.casefold())
    return re.sub(r"[^a-z0-9]", "", plain.removeprefix("bzn|").removeprefix("cty|"))


_CODES: Final = {_key(alias): code for code, names in _NAMES.items() for alias in (code, *names.split(", "))}


def zone_code(name: str) -> str:
    """Return the code of a bidding zone; an unknown name is returned in plain letters."""
    key = _key(name)
    return _CODES.get(key, key)


def is_zone(name: str) -> bool:
    """Return whether `name` is a known bidding zone."""
    return _key(name) in _CODES


def wanted_codes(zone: str) -> tuple[str, ...]:
    """Return the codes that make up the series of `zone`: its own and its predecessor's."""
    code = zone_code(zone)
    return (code, "DE-AT-LU") if code == "DE-LU" else (code,)


def only_day_ahead(product: str | None) -> str:
    """Return the product of a format that holds day-ahead prices only; raise InputError for any other."""
    if product not in (None, DAY_AHEAD):
        fail(1, f"there is no product {product!r} in this file; it holds {DAY_AHEAD}")
    return DAY_AHEAD


def fail_no_zone(zone: str, names: Iterable[str]) -> NoReturn:
    """Raise an InputError for a zone that the file does not contain."""
    fail(1, f"zone {zone!r} is not in this file; choose another zone or file, the file has: {listed(names)}")


def check_known(zone: str) -> None:
    """Raise InputError for an unknown zone; for files that name no zone."""
    if not is_zone(zone):
        fail(1, f"zone {zone!r} is unknown and the file names no zone; leave zone out to take its prices")


def check_values(zone: str, values: pd.Series, names: Iterable[str]) -> None:
    """Raise InputError if the prices of a zone are all missing; `names` are the zones of the file."""
    if values.isna().all():
        fail(
            values.index[0],
            f"from here to line {values.index[-1]} zone {zone!r} has no value; "
            f"choose another zone or file, the file has: {listed(names)}",
        )
