"""Journal of a plant: measurements, demand, and recommended and written set-points, one record per reading.

A folder with ``journal.json`` (the plant and the format) and ``journal/`` with one file for each day (UTC). A
record has a fixed number of bytes, so an incomplete last one, after a kill or on a full disk, is detected by
the length of the file and cut off.

The present day is written to ``2026-11-22.bin``. When another day begins, the file is renamed to
``2026-11-22.0.full`` at once, and a separate thread compresses it to ``2026-11-22.0.gz``. If the clock is set
back, records go to a new file of the same day. Beyond a size limit, the oldest days are deleted.
"""

from __future__ import annotations

import errno
import gzip
import json
import os
import time
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import fields
from datetime import UTC
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, Field, ValidationError

from bess import __version__
from bess.edge.plant_io.calls import Aside
from bess.edge.plant_io.link import Measurements
from bess.errors import InputError
from bess.files import path_of
from bess.simulation.record.files import put_bytes
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr

SYNC_S: Final = 10.0
"""Maximum period of records lost in a power failure; a killed process loses none."""
HEADER: Final = "journal.json"
RECORDS: Final = "journal"
_OPEN, _FULL, _PACKED = ".bin", ".full", ".gz"

_COLUMNS: Final = {
    "demand_kw": ("<f8", "kW", "power asked of the plant, positive = discharge"),
    "power_kw": ("<f4", "kW", "AC power that the string delivered, positive = discharge"),
    "recommended_kw": ("<f4", "kW", "set-point that the controller recommended, positive = discharge"),
    "written_kw": ("<f4", "kW", "set-point that reached the plant; NaN where none was written"),
    "soc": ("<f4", "1", "state of charge as read"),
    "temperature_c": ("<f4", "degC", "temperature as read"),
    "charge_limit_kw": ("<f4", "kW", "charge power that the plant allowed"),
    "discharge_limit_kw": ("<f4", "kW", "discharge power that the plant allowed"),
    "available": ("i1", "1", "1 where the string took set-points"),
}
"""Type, unit and meaning, in the order of a record; all except the demand have a value for each string."""
_MEASURED: Final = _COLUMNS.keys() & {column.name for column in fields(Measurements)}


class _Header(BaseModel, strict=True):
    """Content of ``journal.json``; ``system`` is the text of a system file."""

    format: Literal[1] = 1
    n_strings: Annotated[int, Field(gt=0, le=10_000)]
    title: str
    system: str
    bess_version: str = __version__

    @classmethod
    def of(cls, directory: Path) -> _Header:
        """Raise InputError if the folder has no header or a damaged one."""
        path = directory / HEADER
        try:
            return cls.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            raise InputError(f"{directory}: holds no journal of a plant") from None
        except (OSError, ValidationError) as error:
            why = error.errors()[0]["msg"] if isinstance(error, ValidationError) else error
            raise InputError(f"{path}: is damaged ({why}); without it the journal cannot be read") from error

    def layout(self) -> np.dtype[np.void]:
        """Layout of a record."""
        columns = [
            (name, kind, () if name == "demand_kw" else (self.n_strings,))
            for name, (kind, _, _) in _COLUMNS.items()
        ]
        return np.dtype([("time_ms", "<i8"), *columns])


class Journal:
    """Appends to the journal of a plant, a new or an existing one, in a folder that may hold other files.

    A disk failure neither stops the caller nor delays it for more than a moment: :attr:`error` reports it,
    and the next :meth:`append` tries again. ``title`` is the title of the report. Beyond ``max_mb``, the
    oldest days before today are removed.
    """

    def __init__(self, directory: Path, system: System, title: str, max_mb: float = 2000.0) -> None:
        self._directory, self._records, self._max_bytes = directory, directory / RECORDS, 1e6 * max_mb
        self._header = _Header(n_strings=system.n_strings, title=title, system=system.to_toml())
        self._layout = self._header.layout()
        self._aside, self._packer = Aside("journal"), ThreadPoolExecutor(1, "journal")
        self._has_header = False
        self._file: BinaryIO | None = None
        self._path = directory
        self._synced_s = time.monotonic()
        self._gap = self._damage = self._unpacked = ""
        try:
            before = _Header.of(directory) if is_journal(directory) else self._header
        except InputError as error:
            self._gap = self._damage = str(error)
            return
        if before.n_strings != system.n_strings:
            raise InputError(
                f"{directory}: holds the journal of a plant of {before.n_strings} strings, "
                f"this one has {system.n_strings}; use another folder"
            )
        self._do(lambda: None)

    @property
    def error(self) -> str:
        """Present disk failure, in a sentence; empty without one."""
        return self._gap or self._unpacked

    def append(
        self,
        measurements: Measurements,
        demand_kw: float,
        recommended_kw: ArrayLike,
        written_kw: ArrayLike | None = None,
    ) -> None:
        """Append a reading with the demand, the set-points of the controller, and those written [kW].

        ``written_kw`` is None if none were written, as with ``--shadow`` or without a link.
        """
        record = np.zeros((), dtype=self._layout)
        record["time_ms"] = round(1000.0 * measurements.time.timestamp())
        record["demand_kw"] = demand_kw
        record["recommended_kw"] = recommended_kw
        record["written_kw"] = np.nan if written_kw is None else written_kw
        for name in _MEASURED:
            record[name] = getattr(measurements, name)
        day = measurements.time.astimezone(UTC).strftime("%Y-%m-%d")
        self._do(lambda: self._write(self._records / f"{day}{_OPEN}", record.tobytes()))

    def close(self) -> None:
        """Close the files, and wait until earlier days are packed."""
        with suppress(OSError):
            self._aside(self._close)
        self._aside.close()

    def _do(self, call: Callable[[], None]) -> None:
        """Run an operation on the disk and record its failure."""
        if self._damage:
            return
        try:
            self._aside(lambda: self._on_disk(call))
            self._gap = ""
        except OSError as error:
            why = "the disk does not answer" if isinstance(error, TimeoutError) else error.strerror
            self._gap = f"{self._records}: cannot be written ({why}); the journal of the plant has a gap"

    def _on_disk(self, call: Callable[[], None]) -> None:
        try:
            if not self._has_header:
                self._records.mkdir(parents=True, exist_ok=True)
                put_bytes(self._directory / HEADER, json.dumps(dict(self._header), indent=1).encode())
                self._has_header = True
            call()
        except OSError:
            self._close_day()
            self._has_header = False
            raise

    def _write(self, path: Path, record: bytes) -> None:
        """Append a record to the file of its day, after an incomplete one is removed."""
        if self._file is None or path != self._path:
            self._close_day()
            for other in self._records.glob(f"*{_OPEN}"):
                if other != path:
                    other.rename(self._free(other.stem))
            self._packer.submit(self._tidy)
            self._file, self._path = path.open("ab", buffering=0), path
        size = os.fstat(self._file.fileno()).st_size
        self._file.truncate(size - size % len(record))
        if self._file.write(record) != len(record):
            raise OSError(errno.ENOSPC, "no space for a whole record")
        if time.monotonic() - self._synced_s > SYNC_S:
            os.fsync(self._file.fileno())
            self._synced_s = time.monotonic()

    def _close_day(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _close(self) -> None:
        self._close_day()
        self._packer.shutdown(wait=True)

    def _free(self, day: str) -> Path:
        number = 0
        while any((self._records / f"{day}.{number}{kind}").exists() for kind in (_FULL, _PACKED)):
            number += 1
        return self._records / f"{day}.{number}{_FULL}"

    def _tidy(self) -> None:
        """Pack earlier days, and remove the oldest beyond the limit of size."""
        try:
            for path in sorted(self._records.glob(f"*{_FULL}")):
                put_bytes(path.with_suffix(_PACKED), gzip.compress(path.read_bytes(), 6))
                path.unlink()
            self._unpacked = ""
        except OSError as error:
            self._unpacked = f"{self._records}: earlier days cannot be compressed ({error.strerror})"
        sizes = {path: path.stat().st_size for path in _files(self._records) if path.suffix != _OPEN}
        total = sum(sizes.values())
        for path, size in sizes.items():
            if total > self._max_bytes:
                path.unlink(missing_ok=True)
                total -= size


def _files(directory: Path) -> list[Path]:
    return sorted(path for path in directory.glob("*") if path.suffix in (_OPEN, _FULL, _PACKED))


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
        return gzip.decompress(content) if path.suffix == _PACKED else content
    except FileNotFoundError:
        raise
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read ({error})") from error


def is_journal(directory: Path) -> bool:
    """Whether a folder holds the journal of a plant."""
    return (directory / HEADER).is_file()


def open_journal(directory: str | Path) -> xr.Dataset:
    """Return a journal as a dataset with the dimensions ``time`` (UTC, rising) and ``string``.

    If readings have the same time, because the clock was set back, the last one is kept.

    Raises
    ------
    InputError
        The folder holds no journal, an empty one, or one of another format.
    """
    import xarray as xr

    directory = path_of(directory, "folder")
    header = _Header.of(directory)
    layout = header.layout()
    while True:
        try:
            contents = [_content(path) for path in _files(directory / RECORDS)]
            break
        except FileNotFoundError:
            continue  # packed or removed meanwhile by a running service
    size = layout.itemsize
    days = [np.frombuffer(content[: len(content) // size * size], dtype=layout) for content in contents]
    records = np.concatenate([np.zeros(0, dtype=layout), *days])
    if not records.size:
        raise InputError(
            f"{directory}: the journal is empty; a record is written for each control step of "
            "bess serve with --plant, from the first demand on"
        )
    records = records[np.argsort(records["time_ms"], kind="stable")]
    records = records[np.append(np.diff(records["time_ms"]) > 0, True)]
    dims = ("time", "string")
    variables = {
        name: (dims[: records[name].ndim], records[name], {"units": units, "long_name": meaning})
        for name, (_, units, meaning) in _COLUMNS.items()
    }
    return xr.Dataset(
        variables,
        coords={
            "time": records["time_ms"].astype("datetime64[ms]"),
            "string": np.arange(header.n_strings),
        },
        attrs=header.model_dump(include={"title", "system", "bess_version"}) | {"time_zone": "UTC"},
    )
