"""Excel workbooks (xlsx): the first sheet with a table."""

import io
import warnings
from datetime import date, datetime, time
from typing import Any, Final

import pandas as pd

from bess.errors import InputError
from bess.files import MAX_BYTES
from bess.market.files import fail
from bess.optional_dependencies import extra

_MIN_ROWS: Final = 3


def is_workbook(raw: bytes) -> bool:
    """Return whether a file is a workbook, by its content."""
    return raw[:4] == b"PK\x03\x04"


def workbook_rows(raw: bytes) -> list[tuple[int, list[str]]]:
    """Return the numbered rows of the first sheet with a few rows and columns."""
    with extra("market", "an Excel workbook"):
        import openpyxl
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about styles and extensions, which are not needed
            book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
            for sheet in book.worksheets:
                rows = _rows(sheet)
                if sum(sum(map(bool, cells)) > 1 for _, cells in rows) >= _MIN_ROWS:
                    return rows
    except InputError:
        raise
    except Exception as error:  # openpyxl, zipfile and zlib each have their own exception for damaged bytes
        what = str(error) or type(error).__name__
        fail(None, f"the workbook is damaged or truncated ({what}); fetch it again")
    fail(None, "no sheet of the workbook holds a table; save the sheet wanted as CSV")


def _rows(sheet: Any) -> list[tuple[int, list[str]]]:
    rows, size = [], 0
    for line, row in enumerate(sheet.iter_rows(values_only=True), 1):
        cells = [_cell(value) for value in row]
        rows.append((line, cells))
        size += sum(map(len, cells)) + len(cells)
        if size > MAX_BYTES:
            fail(None, f"the sheet holds more than {MAX_BYTES // 2**20} MiB; cut it down")
    return rows


def _cell(value: Any) -> str:
    """Return a cell as text; times stored as a number of days are rounded to the second."""
    if value is None:
        return ""
    if isinstance(value, datetime):
        return f"{pd.Timestamp(value).round('s'):%Y-%m-%d %H:%M:%S}"
    if isinstance(value, date):
        return f"{value:%Y-%m-%d}"
    if isinstance(value, time):
        return f"{value:%H:%M:%S}"
    return repr(value) if isinstance(value, float) else str(value).strip()
