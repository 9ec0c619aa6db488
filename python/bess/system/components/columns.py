"""Small tables from text files and Parquet, as columns of texts or numbers."""

import csv
import io
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path

import numpy as np

from bess.arrays import Array
from bess.errors import InputError, listed, placed
from bess.files import read_file
from bess.optional_dependencies import extra

Columns = dict[str, list[str]]


@contextmanager
def columns_of(path: str | Path) -> Iterator[Columns]:
    """Yield the cells of a file as text: Parquet, or a table with a header, separated by ``,``, ``;`` or tab.

    A comma is a decimal comma where ``;`` or a tab separates the columns. Rows may be shorter than the
    header. Errors raised inside the block are reported with the path of the file.
    """
    raw = read_file(path)
    with placed(str(path)):
        yield _parquet(raw) if Path(path).suffix == ".parquet" else _text(raw)


def _text(raw: bytes) -> Columns:
    try:
        text = raw.decode("utf-8-sig")
        separator = max(";\t,", key=text.partition("\n")[0].count)
        rows = list(csv.reader(io.StringIO(text), delimiter=separator))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read as a table ({error})") from error
    if len(rows) < 2:
        raise InputError(f"has {len(rows)} lines; a table has a header and at least one row")
    header, *body = rows
    for number, row in enumerate(body, start=2):
        if len(row) > len(header):
            raise InputError(f"line {number} has {len(row)} cells, the header has {len(header)}")
    body = [row for row in body if any(cell.strip() for cell in row)]
    if not body:
        raise InputError("has a header and no rows")
    columns: Columns = {}
    for title, *cells in zip_longest(header, *body, fillvalue=""):
        name = " ".join(title.split())
        if name and name in columns:
            raise InputError(f"two columns have the title {name!r}; name them apart")
        texts = [cell.strip() for cell in cells]
        columns[name] = texts if separator == "," else [text.replace(",", ".") for text in texts]
    return columns


def _parquet(raw: bytes) -> Columns:
    with extra("market", "a Parquet file"):
        import pyarrow.parquet as pq
    try:
        table = pq.read_table(io.BytesIO(raw)).to_pydict()
    except Exception as error:  # damaged bytes raise almost any exception in pyarrow
        raise InputError(f"the Parquet file is damaged or truncated ({error})") from error
    return {str(k): ["nan" if v is None else str(v) for v in column] for k, column in table.items()}


def number(columns: Columns, name: str, row: int, *, gaps: bool = False) -> float:
    """Return a cell (``row`` from 0) as a finite number; with ``gaps``, an empty cell and NaN are NaN."""
    cell = columns[name][row]
    try:
        value = float(cell) if cell or not gaps else np.nan
    except ValueError:
        value = np.inf
    if not (np.isfinite(value) or (gaps and np.isnan(value))):
        raise InputError(f"row {row + 1} of column {name!r} is {cell!r}, must be a number")
    return value


def numbers(columns: Columns, name: str, *, gaps: bool = False) -> Array:
    """Return a column as numbers; see :func:`number`."""
    if name not in columns:
        raise InputError(f"no column {name}; columns are {listed(columns)}")
    return np.array([number(columns, name, row, gaps=gaps) for row in range(len(columns[name]))])
