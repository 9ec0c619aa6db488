"""Bytes of any file that holds a table to that table: text, JSON, workbooks, and layouts of their own."""

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from bess.market.day_types import refuse_day_types
from bess.market.files import decode, fail
from bess.market.json_tables import is_json, json_as_csv
from bess.market.layouts import rewritten
from bess.market.repairs import Repairs
from bess.market.table import Table, text_table
from bess.market.workbook import is_workbook, workbook_as_csv

_MARKUP: Final = re.compile(r"\s*<[!?a-zA-Z]")


def read_table(path: str, raw: bytes, repairs: Repairs) -> Table:
    """Return the table in a file; raise InputError where there is none."""
    with _uncollected():
        return _table(path, raw, repairs)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Pause the garbage collector: it would go through millions of rows again and again, and find nothing."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _table(path: str, raw: bytes, repairs: Repairs) -> Table:
    if is_workbook(raw):
        text = workbook_as_csv(path, raw)
        refuse_day_types(path, text)
        return text_table(path, text, repairs)
    text = decode(path, raw, repairs)
    if is_json(text):
        return text_table(path, json_as_csv(path, text), repairs)
    if _MARKUP.match(text):
        kind = "a web page" if "html" in text[:200].casefold() else "XML"
        fail(path, 1, f"is {kind}, not a table; export the data as CSV")
    if (table := rewritten(path, text)) is not None:
        return table
    refuse_day_types(path, text)
    return text_table(path, text, repairs)
