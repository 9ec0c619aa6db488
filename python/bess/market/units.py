"""Units in column names: prices in EUR/MWh, power in kW, temperature in degC, or others."""

import re
from typing import Final

from bess.market.files import fail

_CURRENCIES: Final = (
    "AED|AFN|AMD|AOA|ARS|AUD|AWG|AZN|BBD|BDT|BGN|BHD|BIF|BMD|BND|BRL|BSD|BTN|BWP|BYN|BZD|CAD|CDF|CHF|"
    "CLP|CNH|CNY|CRC|CVE|CZK|DJF|DKK|DOP|DZD|EGP|ERN|ETB|FJD|FKP|GBP|GBX|GHS|GIP|GMD|GNF|GTQ|GYD|HKD|"
    "HNL|HRK|HTG|HUF|IDR|ILS|INR|IQD|IRR|ISK|JMD|JOD|JPY|KES|KGS|KHR|KMF|KPW|KRW|KWD|KYD|KZT|LBP|LKR|"
    "LRD|LSL|LYD|MDL|MGA|MKD|MMK|MNT|MRU|MUR|MVR|MWK|MXN|MYR|MZN|NAD|NGN|NIO|NOK|NPR|NZD|OMR|PGK|PHP|"
    "PKR|PLN|PYG|QAR|RON|RSD|RUB|RWF|SAR|SBD|SCR|SDG|SEK|SGD|SHP|SLE|SRD|SSP|STN|SVC|SYP|SZL|THB|TJS|"
    "TMT|TND|TRY|TTD|TWD|TZS|UAH|UGX|USD|UYU|UZS|VES|VND|VUV|WST|XAF|XCD|XOF|XPF|YER|ZAR|ZMW|ZWL"
)
"""ISO 4217 without EUR and without codes that are words."""
_WORDS: Final = "ALL|ANG|BAM|BOB|COP|CUP|GEL|LAK|MAD|MOP|PAB|PEN|SOS|TOP"
"""Codes that are words as well: currencies only before a unit of energy."""

_PER: Final = r"\s*(?:/|per\b|je\b|pro\b)\s*"
_FOREIGN: Final = re.compile(
    rf"(?<![a-z])(?:{_CURRENCIES.lower()})(?![a-z])"
    rf"|(?<![a-z])(?:{_WORDS.lower()})(?:{_PER}|\s+)[kmg]?wh"
    r"|[£$¥₺₴₹₽₩₪฿]|(?<![a-z])(?:r\$|us\$)"
    rf"|(?<![a-z])(?:kr|zł|zl|kč|kc|ft|lei|lv|лв|din|rp|p|c){_PER}[kmg]?wh"
    r"|(?<![a-z])(?:ct|cts|cent|cents|penny|pence|öre|øre|ore|grosz|groszy|rappen)(?![a-z])"
    r"|(?<![a-z])[kg]wh(?![a-z])|[\[(]\s*mwh?\s*[\])]"
)
_UPPER: Final = re.compile(rf"(?<![A-Z])(?:{_CURRENCIES})(?=$|[^A-Z]|[KMG]WH?)")
_EURO: Final = re.compile(r"(?<![a-z])(?:eur|euro|euros)(?![a-z])|€|EUR", re.IGNORECASE)
_CURRENCY_COLUMN: Final = re.compile(
    r"(?:price\s+)?(?:currency|währung|devise|valuta|moneda|unit|einheit)(?:\s+code)?", re.IGNORECASE
)

_POWER: Final = re.compile(r"(?<![A-Za-z])(m?W|[kM]W|GW|TW|[kM]?VA|[kM]?var|[kMG]Wh|Wh)(?![A-Za-z])")
_SPELLED: Final = {
    unit.lower(): unit
    for unit in ("W", "kW", "MW", "GW", "kVA", "MVA", "var", "kvar", "Mvar", "Wh", "kWh", "MWh", "GWh")
}
_POWER_WORD: Final = re.compile(rf"(?<![a-z])({'|'.join(_SPELLED)})(?![a-z])")
_FAHRENHEIT: Final = re.compile(
    r"°\s*f\b|(?<![a-z])(?:deg\s*f|fahrenheit)(?![a-z])|[\[({]\s*f\s*[\])}]|(?<=[a-z] )f$"
)


def _plain(name: str) -> str:
    """Return the name as words in lower case: ``spot price dkk per mwh`` for ``SpotPriceDKK_per_MWh``."""
    energy = re.sub(r"[kKMG]W[hH]", lambda unit: f" {unit[0].lower()}", name)
    return re.sub(r"(?<=[a-zäöüß])(?=[A-Z])|(?<=[A-Z])(?=per\b)|_", " ", energy).casefold()


def foreign_unit(column: str) -> str | None:
    """Return the unit in the name of a price column if it is not EUR/MWh, otherwise None."""
    found = _UPPER.search(column) or _FOREIGN.search(_plain(column))
    return found[0].strip() if found else None


def names_euro(column: str) -> bool:
    """Return whether a column name gives euros as the currency."""
    return bool(_EURO.search(_plain(column)))


def names_currency(column: str) -> bool:
    """Return whether a column name gives a currency."""
    return names_euro(column) or bool(_UPPER.search(column))


def check_price_unit(column: str) -> None:
    """Raise InputError if a column name gives a unit other than EUR/MWh."""
    other = foreign_unit(column)
    if other:
        fail(1, f"column {column!r} is in another unit ({other}) than EUR/MWh; convert it first")


def is_currency_column(name: str) -> bool:
    """Return whether a column holds the currency or the unit of the price column."""
    return bool(_CURRENCY_COLUMN.fullmatch(_plain(name).strip()))


def power_unit(column: str) -> str | None:
    """Return the unit of power (active, reactive, apparent) or energy in a column name, or None."""
    found = _POWER.search(column.replace("_", " "))
    if found:
        return found[1]
    word = _POWER_WORD.search(_plain(column))
    return _SPELLED[word[1]] if word else None


def check_temperature_unit(column: str) -> None:
    """Raise InputError if a column name gives Fahrenheit; kelvin is caught by the range check."""
    if _FAHRENHEIT.search(_plain(column)):
        fail(1, f"column {column!r} is in degrees Fahrenheit; convert it to degC first")
