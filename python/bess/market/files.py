"""File content to text, found from the content (file type, compression, encoding), and its repairs."""

import gzip
import io
import logging
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from typing import Final, NamedTuple, NoReturn

import pandas as pd

from bess.errors import InputError, listed, placed
from bess.files import MAX_BYTES, limited, read_file

log = logging.getLogger("bess.market")

_UTF16_MARKS: Final = (b"\xff\xfe", b"\xfe\xff")
_MARKS: Final = (b"\xef\xbb\xbf", *_UTF16_MARKS)
_STATION: Final = "produkt_"
"""How the member with the values begins in archives of the German weather service."""
_OTHER_KINDS: Final = {
    b"%PDF": "a PDF document; export the table as CSV",
    b"\xd0\xcf\x11\xe0": "an Excel workbook of the old kind (.xls); save it as .xlsx or CSV",
    b"\x89HDF": "an HDF5 or NetCDF file; export the column wanted as CSV",
    b"CDF": "a NetCDF file; export the column wanted as CSV",
    b"7z\xbc\xaf": "a 7z archive; unpack it first",
    b"Rar!": "a RAR archive; unpack it first",
    b"BZh": "a bzip2 archive; unpack it first",
    b"\xfd7zXZ": "an xz archive; unpack it first",
}


class Repair(NamedTuple):
    """One kind of repair: description, number of rows, and first line of the file concerned.

    Attributes
    ----------
    kind : str
        Short machine-readable name, such as ``"autumn-hour"`` or ``"gap-filled"``.
    text : str
        Description of the correction.
    rows : int
        Rows or values concerned.
    line : int or None
        First line of the file concerned (1-based), if there is one.
    """

    kind: str
    text: str
    rows: int = 1
    line: int | None = None

    def __str__(self) -> str:
        place = "" if self.line is None else f" from line {self.line}"
        return f"{self.text} ({self.rows} row{'s' if self.rows != 1 else ''}{place})"


class Repairs(list[Repair]):
    """The repairs of one file in the order they were made; kept in ``series.attrs["repairs"]``."""

    def add(self, kind: str, text: str, rows: int = 1, line: int | None = None) -> None:
        """Add a repair, unless it concerns no rows."""
        if rows:
            self.append(Repair(kind, text, int(rows), None if line is None else int(line)))

    def add_where(self, kind: str, text: str, where: "pd.Series[bool]") -> None:
        """Add a repair of the lines that satisfy a condition."""
        self.add(kind, text, where.sum(), first_line(where))

    def rows(self, kind: str) -> int:
        """Return the number of rows with repairs of the given kind."""
        return sum(repair.rows for repair in self if repair.kind == kind)

    def report(self, path: str) -> None:
        """Log all repairs as one line, level INFO, on the logger ``bess.market``."""
        if self:
            log.info("%s: %s", path, "; ".join(map(str, self)))


def fail(line: int | None, text: str) -> NoReturn:
    """Raise an InputError with the line, if known, the problem and the remedy."""
    raise InputError(text if line is None else f"line {line}: {text}")


def first_line(where: "pd.Series[bool]") -> int | None:
    """Return the first line that satisfies a condition, None if no line does."""
    return int(str(where.idxmax())) if where.any() else None


@contextmanager
def reading(path: str | PathLike[str]) -> Iterator[tuple[bytes, Repairs]]:
    """Yield the unpacked content of a file and the list of its repairs, which is logged at the end.

    Errors raised inside the block are reported with the path of the file.
    """
    raw, repairs, name = read_file(path), Repairs(), str(path)
    with placed(name):
        yield _unpacked(raw), repairs
    repairs.report(name)


def _unpacked(raw: bytes) -> bytes:
    """Unpack a gzip or zip archive of one file; a workbook (xlsx) stays as it is."""
    try:
        if raw[:2] == b"\x1f\x8b":
            with gzip.GzipFile(fileobj=io.BytesIO(raw)) as packed:
                raw = limited(packed, "the archive")
        if raw[:4] == b"PK\x03\x04":
            raw = _unzip(raw)
    except InputError:
        raise
    except RuntimeError as error:  # a password
        fail(None, f"the archive cannot be unpacked ({error}); unpack it first")
    except Exception as error:  # each kind of compression has its own exception for damaged bytes
        what = str(error) or type(error).__name__
        fail(None, f"the archive is damaged or truncated ({what}); fetch the file again")
    if not raw.removeprefix(next((mark for mark in _MARKS if raw.startswith(mark)), b"")).strip():
        fail(1, "the file is empty; fetch it again")
    for mark, kind in _OTHER_KINDS.items():
        if raw.startswith(mark):
            fail(None, f"is {kind}")
    return raw


def _unzip(raw: bytes) -> bytes:
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        members = [m for m in archive.namelist() if not m.endswith("/") and not m.startswith("__MACOSX")]
        if "[Content_Types].xml" in members:
            if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                fail(None, f"the workbook holds more than {MAX_BYTES // 2**20} MiB; save the sheet as CSV")
            return raw
        station = [m for m in members if m.rpartition("/")[2].startswith(_STATION)]
        members = station if len(station) == 1 else members
        if len(members) != 1:
            fail(None, f"the archive holds {len(members)} files ({listed(members)}); unpack the one wanted")
        with archive.open(members[0]) as packed:
            return limited(packed, "the archive")


def decode(raw: bytes, repairs: Repairs) -> str:
    """Return the text of `raw`: UTF-8 with or without a mark, UTF-16 with one, else Windows-1252.

    A file that is UTF-8 in one line and something else in another is refused: its letters cannot be trusted.
    """
    if raw[:2] in _UTF16_MARKS:
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError:
            fail(None, "the file is UTF-16 but damaged or truncated; fetch it again")
    if b"\x00" in raw:
        line = raw[: raw.index(b"\x00")].count(b"\n") + 1
        fail(line, "holds a zero byte, so this is not a text file; give a CSV or Parquet file")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        bad = raw[: error.start].count(b"\n") + 1
    for number, text in enumerate(raw.splitlines(), 1):
        if not text.isascii() and _is_utf8(text):
            fail(bad, f"is not UTF-8 while line {number} is: mixed encodings; save the file in one encoding")
    repairs.add("encoding", "read as Windows-1252, not UTF-8", 1, bad)
    return raw.decode("cp1252", errors="replace")


def _is_utf8(line: bytes) -> bool:
    try:
        line.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True
