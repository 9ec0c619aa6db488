"""The files of a journal: one for each day, packed when it is over; the oldest go when there is no room.

A day is written to ``2026-11-22.bin``. When another begins it becomes ``2026-11-22.0.full`` at once, and
``2026-11-22.0.gz`` a little later, in a thread of its own, which holds up nobody. A clock that is set back
goes on in a new file of the same day.
"""

from __future__ import annotations

import errno
import gzip
import os
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO, Final

from bess.errors import InputError

SYNC_S: Final = 10.0
"""What a loss of power may cost; a killed process loses nothing."""
_OPEN, _FULL, _PACKED, _PART = ".bin", ".full", ".gz", ".part"


class DayFiles:
    """Appends records to the file of a day.

    Parameters
    ----------
    directory
        Where the files are.
    record_bytes
        Size of a record.
    most_bytes
        What the days that are over may take; the oldest are removed.

    Attributes
    ----------
    error : str
        What went wrong with packing or removing, last time; empty if nothing did.
    """

    def __init__(self, directory: Path, record_bytes: int, most_bytes: float) -> None:
        self._directory, self._record_bytes, self._most_bytes = directory, record_bytes, most_bytes
        self.error = ""
        self._file: BinaryIO | None = None
        self._path = directory
        self._synced_s = time.monotonic()
        self._packer = ThreadPoolExecutor(1, "journal")

    def append(self, day: str, record: bytes) -> None:
        """Append a record to a day, ``2026-11-22``.

        Raises
        ------
        OSError
            If it cannot be written whole; the next call tries anew.
        """
        path = self._directory / f"{day}{_OPEN}"
        if self._file is None or path != self._path:
            self.close_day()
            self._put_by(path)
            self._file, self._path = path.open("ab", buffering=0), path
        # Whatever was left of a record that could not be written whole goes before the next.
        whole = os.fstat(self._file.fileno()).st_size // self._record_bytes * self._record_bytes
        self._file.truncate(whole)
        written = self._file.write(record)
        if written != len(record):
            raise OSError(errno.ENOSPC, "no space for a whole record")
        if time.monotonic() - self._synced_s > SYNC_S:
            os.fsync(self._file.fileno())
            self._synced_s = time.monotonic()

    def close_day(self) -> None:
        """Close the file of the day; the next :meth:`append` opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def close(self) -> None:
        """Close the file of the day, and wait until those before it are packed."""
        self.close_day()
        self._packer.shutdown(wait=True)

    def _put_by(self, today: Path) -> None:
        """Put the files of other days by; pack them, and remove the oldest, aside."""
        for path in self._directory.glob(f"*{_OPEN}"):
            if path != today:
                path.rename(self._free(path.stem))
        self._packer.submit(self._tidy)

    def _free(self, day: str) -> Path:
        number = 0
        while any((self._directory / f"{day}.{number}{kind}").exists() for kind in (_FULL, _PACKED)):
            number += 1
        return self._directory / f"{day}.{number}{_FULL}"

    def _tidy(self) -> None:
        try:
            for path in sorted(self._directory.glob(f"*{_FULL}")):
                part = path.with_suffix(_PART)
                with part.open("wb") as file:
                    file.write(gzip.compress(path.read_bytes(), 6))
                    file.flush()
                    os.fsync(file.fileno())
                part.replace(path.with_suffix(_PACKED))
                path.unlink()
            self.error = ""
        except OSError as error:
            self.error = f"{self._directory}: days that are over cannot be packed ({error.strerror})"
        self._remove_oldest()

    def _remove_oldest(self) -> None:
        over = sorted(path for path in _files(self._directory) if path.suffix != _OPEN)
        sizes = [path.stat().st_size for path in over]
        total = sum(sizes)
        for path, size in zip(over, sizes, strict=True):
            if total > self._most_bytes:
                path.unlink(missing_ok=True)
                total -= size


def contents(directory: Path) -> list[bytes]:
    """What each file holds, the oldest day first; the last record of one may be torn.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    while True:
        try:
            return [_content(path) for path in sorted(_files(directory))]
        except FileNotFoundError:
            continue  # packed or removed meanwhile by a service that runs


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
        return gzip.decompress(content) if path.suffix == _PACKED else content
    except FileNotFoundError:
        raise
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read ({error})") from error


def _files(directory: Path) -> list[Path]:
    return [path for path in directory.glob("*") if path.suffix in (_OPEN, _FULL, _PACKED)]
