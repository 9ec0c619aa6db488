"""Excel workbooks (xlsx) as the table on their first sheet that has one."""

import csv
import io
import warnings
from datetime import date, datetime, time
from typing import Any, Final

from bess.errors import InputError
from bess.extras import extra
from bess.files import LARGEST_BYTES
from bess.market.files import fail

_FEWEST_ROWS: Final = 3


def is_workbook(raw: bytes) -> bool:
    """Tell whether the content of a file is that of a workbook."""
    return raw[:4] == b"PK\x03\x04"


def workbook_as_csv(path: str, raw: bytes) -> str:
    """Return the first sheet with a few rows and columns as CSV; line numbers are those of its rows."""
    with extra("market", f"{path}: an Excel workbook"):
        import openpyxl
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions that are not read
            book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
            for sheet in book.worksheets:
                text = _as_csv(path, sheet)
                if text is not None:
                    return text
    except InputError:
        raise
    except Exception as error:  # openpyxl, zipfile and zlib each have their own for damaged bytes
        what = str(error) or type(error).__name__
        fail(path, None, f"the workbook is damaged or truncated ({what}); fetch it again")
    fail(path, None, "no sheet of the workbook holds a table; save the sheet wanted as CSV")


def _as_csv(path: str, sheet: Any) -> str | None:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    wide = 0
    for row in sheet.iter_rows(values_only=True):
        cells = [_cell(value) for value in row]
        wide += sum(map(bool, cells)) > 1
        writer.writerow(cells or [""])
        if out.tell() > LARGEST_BYTES:
            fail(path, None, f"the sheet holds more than {LARGEST_BYTES // 2**20} MiB; cut it down")
    return out.getvalue() if wide >= _FEWEST_ROWS else None


def _cell(value: Any) -> str:
    """A cell as text; a time that a spreadsheet keeps as a number of days is rounded to the second."""
    if value is None:
        return ""
    if isinstance(value, datetime):
        return f"{_rounded(value):%Y-%m-%d %H:%M:%S}"
    if isinstance(value, date):
        return f"{value:%Y-%m-%d}"
    if isinstance(value, time):
        return f"{value:%H:%M:%S}"
    return repr(value) if isinstance(value, float) else str(value).strip()


def _rounded(value: datetime) -> datetime:
    import pandas as pd

    return pd.Timestamp(value).round("s").to_pydatetime()
