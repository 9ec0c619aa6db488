"""Tables in JSON documents of web services: columns as lists, or one record for each time."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from bess.files import parse_json
from bess.market.files import fail

_OFFSET: Final = "utc_offset_seconds"


def is_json(text: str) -> bool:
    """Return whether a text begins like a JSON document."""
    return text.lstrip()[:1] in ("{", "[")


def json_rows(text: str) -> list[tuple[int, list[str]]]:
    """Return the rows of the largest table in a JSON document, below its UTC offset if it has one.

    The reader accepts documents of PVGIS, Open-Meteo, Energy-Charts, Energi Data Service, aWATTar and SMARD,
    and others with lists of equal length, a list of records, or a list of pairs.
    """
    try:
        document = parse_json(text)
    except ValueError as error:
        fail(None, f"begins like JSON but is damaged or truncated ({error}); fetch it again")
    tables = [table for table in _tables(document) if table[1]]
    if not tables:
        fail(None, "is JSON without a list of times and values; export the series as CSV")
    names, rows = max(tables, key=lambda table: len(table[1]))
    units = _units(document, names)
    head: list[list[Any]] = [[f"{name} ({units[name]})" if units.get(name) else name for name in names]]
    if isinstance(document, Mapping) and _is_leaf(offset := document.get(_OFFSET, [])):
        head = [[_OFFSET], [offset], *head]
    every = enumerate([*head, *rows], 1)
    return [(line, ["" if cell is None else str(cell) for cell in row]) for line, row in every]


def _tables(node: Any) -> Iterator[tuple[list[str], list[list[Any]]]]:
    """Yield the column names and rows of every table in a document."""
    if isinstance(node, Mapping):
        lists = {str(key): value for key, value in node.items() if _is_column(value)}
        longest = max(map(len, lists.values()), default=0)
        columns = {key: value for key, value in lists.items() if len(value) == longest}
        if len(columns) > 1:
            yield list(columns), [list(row) for row in zip(*columns.values(), strict=True)]
        for value in node.values():
            yield from _tables(value)
    elif isinstance(node, list) and node:
        if all(isinstance(entry, Mapping) for entry in node):
            names = [str(key) for key, value in node[0].items() if _is_leaf(value)]
            yield names, [[entry.get(name) for name in names] for entry in node]
        elif all(isinstance(entry, list) and len(entry) == 2 and all(map(_is_leaf, entry)) for entry in node):
            yield ["time", "value"], node


def _units(document: Any, names: list[str]) -> dict[str, str]:
    """Return the units of columns: from a separate table (Open-Meteo) or one common unit (Energy-Charts)."""
    if not isinstance(document, Mapping):
        return {}
    one = document.get("unit")
    units = dict.fromkeys(names[1:], one) if isinstance(one, str) else {}
    for key, table in document.items():
        if str(key).endswith("_units") and isinstance(table, Mapping):
            units |= {str(name): str(unit) for name, unit in table.items() if unit != "iso8601"}
    return units


def _is_column(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(map(_is_leaf, value))


def _is_leaf(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)
