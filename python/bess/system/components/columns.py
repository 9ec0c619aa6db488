"""Small tables from text files and Parquet, as columns of texts or numbers."""

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError
from bess.files import read_file
from bess.optional_dependencies import extra

Columns = dict[str, list[str]]


def read_columns(path: str | Path) -> Columns:
    """Read a table with one header line, separated by ``,``, ``;`` or tab, or a Parquet file; cells as text.

    A comma is a decimal comma where ``;`` or a tab separates the columns. Rows may be shorter than the
    header.
    """
    path, raw = Path(path), read_file(path)
    if path.suffix == ".parquet":
        return _parquet(path, raw)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read as a table ({error})") from error
    lines = text.splitlines()
    if len(lines) < 2:
        raise InputError(f"{path}: has {len(lines)} lines; a table has a header and at least one row")
    separator = max(";\t,", key=lines[0].count)
    try:
        rows = list(csv.reader(io.StringIO(text), delimiter=separator))
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read as a table ({error})") from error
    header, body = rows[0], [row for row in rows[1:] if any(cell.strip() for cell in row)]
    for number, row in enumerate(rows[1:], start=2):
        if len(row) > len(header):
            raise InputError(f"{path}: line {number} has {len(row)} cells, the header has {len(header)}")
    if not body:
        raise InputError(f"{path}: has a header and no rows")
    columns = {}
    for index, name in enumerate(header):
        cells = [row[index].strip() if index < len(row) else "" for row in body]
        columns[" ".join(name.split())] = (
            [cell.replace(",", ".") for cell in cells] if separator != "," else cells
        )
    return columns


def _parquet(path: Path, raw: bytes) -> Columns:
    with extra("market", f"{path}: a Parquet file"):
        import pyarrow.parquet as pq
    try:
        table = pq.read_table(io.BytesIO(raw)).to_pydict()
    except Exception as error:  # damaged bytes raise almost any exception in pyarrow
        raise InputError(f"{path}: the Parquet file is damaged or truncated ({error})") from error
    return {str(k): ["nan" if v is None else str(v) for v in column] for k, column in table.items()}


def numbers(path: str | Path, columns: Columns, name: str, *, gaps: bool = False) -> NDArray[np.float64]:
    """Column ``name`` as finite numbers; with ``gaps``, empty cells and NaN are NaN."""
    values = np.empty(len(columns[name]))
    for row, cell in enumerate(columns[name]):
        try:
            values[row] = float(cell) if cell or not gaps else np.nan
        except ValueError:
            values[row] = np.inf
        if not (np.isfinite(values[row]) or (gaps and np.isnan(values[row]))):
            raise InputError(f"{path}: row {row + 1} of column {name!r} is {cell!r}, must be a number")
    return values
