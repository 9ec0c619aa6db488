"""Bytes of a file to text: compression and encoding, found from the content."""

import gzip
import io
import zipfile
import zlib
from os import PathLike, fspath
from pathlib import Path
from typing import NoReturn

from bess.errors import InputError
from bess.market.repairs import Repairs

_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def fail(path: str, line: int | None, text: str) -> NoReturn:
    """Raise the InputError of a file: path, line if there is one, what is wrong and what to do."""
    place = path if line is None else f"{path}: line {line}"
    raise InputError(f"{place}: {text}")


def read_bytes(path: str | PathLike[str]) -> bytes:
    """Return the content of a file, unpacked if it is a gzip or zip archive of one file."""
    name = fspath(path)
    try:
        raw = Path(name).read_bytes()
    except FileNotFoundError:
        fail(name, None, "there is no such file; check the path")
    except (OSError, ValueError) as error:  # a path with a NUL in it is a ValueError
        cause = getattr(error, "strerror", None) or error
        fail(name, None, f"cannot be read ({cause}); check the path and its permissions")
    try:
        if raw[:2] == b"\x1f\x8b":
            raw = gzip.decompress(raw)
        elif raw[:4] == b"PK\x03\x04":
            raw = _unzip(name, raw)
    except (EOFError, zlib.error, gzip.BadGzipFile, zipfile.BadZipFile) as error:
        fail(name, None, f"the archive is damaged or truncated ({error}); fetch the file again")
    if not raw.strip():
        fail(name, 1, "the file is empty; fetch it again")
    return raw


def _unzip(name: str, raw: bytes) -> bytes:
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        members = [m for m in archive.namelist() if not m.endswith("/") and not m.startswith("__MACOSX")]
        if "[Content_Types].xml" in members:
            fail(name, None, "this is an Excel workbook; save the sheet as CSV")
        if len(members) != 1:
            fail(
                name,
                None,
                f"the archive holds {len(members)} files ({', '.join(members[:5])}); unpack the one wanted",
            )
        return archive.read(members[0])


def decode(path: str, raw: bytes, repairs: Repairs) -> str:
    """Return the text of `raw`: UTF-8 with or without a mark, UTF-16 with one, else Windows-1252.

    A file that is UTF-8 in one line and something else in another is refused: its letters cannot be trusted.
    """
    if raw[:2] in _UTF16_MARKS:
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError:
            fail(path, None, "the file is UTF-16 but damaged or truncated; fetch it again")
    if b"\x00" in raw:
        line = raw[: raw.index(b"\x00")].count(b"\n") + 1
        fail(path, line, "holds a zero byte, so this is not a text file; give a CSV or Parquet file")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        bad = raw[: error.start].count(b"\n") + 1
    for number, text in enumerate(raw.splitlines(), 1):
        if not text.isascii() and _is_utf8(text):
            fail(
                path,
                bad,
                f"is not UTF-8 while line {number} is: mixed encodings; save the file in one encoding",
            )
    repairs.add("encoding", "read as Windows-1252, not UTF-8", 1, bad)
    return raw.decode("cp1252", errors="replace")


def _is_utf8(line: bytes) -> bool:
    try:
        line.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True
