"""A run on disk: parts of the record, each with the checkpoint that continues after it.

A part is one file that is created by a rename. The directory therefore always holds a gap-free record from
step 0 and the state at its end. Steps that were not saved before a crash are computed again on resume. The
first line of a part is a checksum of the rest, which is an ``npz`` archive.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from bess.errors import InputError, option
from bess.simulation.record.atomic import clear_errors, write_bytes
from bess.simulation.record.checksums import sealed, unsealed
from bess.simulation.record.codec import pack, unpack

PARTS = "parts"
LOCK = ".lock"
OWNER = ".lock-owner"
_RECORD = "record/"
_CHECKPOINT = "checkpoint/"

Record = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Part:
    """Some consecutive steps of the record."""

    path: Path

    @property
    def first_step(self) -> int:
        """Index of its first step; the file is named after it."""
        return int(self.path.stem)

    def record(self) -> Record:
        """Arrays with the steps along the first axis."""
        return self._read(_RECORD)

    def checkpoint(self) -> dict[str, Any]:
        """State of the closed loop after its last step."""
        return unpack(self._read(_CHECKPOINT))

    def _read(self, prefix: str) -> Record:
        try:
            with np.load(io.BytesIO(unsealed(self.path.read_bytes())), allow_pickle=False) as archive:
                return {
                    name.removeprefix(prefix): archive[name]
                    for name in archive.files
                    if name.startswith(prefix)
                }
        except (OSError, ValueError, MemoryError) as error:
            raise InputError(
                f"{self.path}: damaged ({error}); delete it and all later parts, then {option('resume')}"
            ) from error


def write_part(directory: Path, first_step: int, record: Record, checkpoint: Mapping[str, Any]) -> None:
    """Save steps from ``first_step`` on, and the state after them, with one atomic write."""
    arrays = {_RECORD + name: array for name, array in record.items()}
    arrays |= {_CHECKPOINT + name: array for name, array in pack(checkpoint).items()}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    with clear_errors(directory):
        (directory / PARTS).mkdir(exist_ok=True)
    write_bytes(directory / PARTS / f"{first_step:08d}.npz", sealed(buffer.getvalue()))


def parts(directory: Path) -> list[Part]:
    """Parts in the order of their steps."""
    return [Part(path) for path in sorted((directory / PARTS).glob("*.npz"))]


def records(directory: Path) -> Iterator[tuple[int, Record]]:
    """Yield the first step and the arrays of each part, with one part in memory at a time.

    Raises
    ------
    InputError
        A part is damaged or missing.
    """
    step = 0
    for part in parts(directory):
        if part.first_step != step:
            raise InputError(
                f"{part.path}: the part before it, from step {step} on, is missing; delete it and all later "
                f"parts, then {option('resume')}"
            )
        record = part.record()
        yield step, record
        step += len(record["demand_kw"])


def remove_parts(directory: Path) -> None:
    """Delete the parts, newest first, so that the record remains gap-free after a crash."""
    for part in reversed(parts(directory)):
        part.path.unlink()
    shutil.rmtree(directory / PARTS, ignore_errors=True)


class Lock:
    """Lock of a run directory against a second process; the system releases it even after ``kill -9``.

    A second file names the owner, because some systems do not allow reading a locked file.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._lock = FileLock(directory / LOCK)

    def __enter__(self) -> Self:
        with clear_errors(self._directory / LOCK):
            try:
                self._lock.acquire(timeout=0)
            except Timeout as error:
                raise InputError(
                    f"{self._directory}: another run (process {self._owner()}) writes there; "
                    f"wait or use another {option('out')}"
                ) from error
        with suppress(OSError):  # a full disk: the lock is still valid
            (self._directory / OWNER).write_text(str(os.getpid()), encoding="ascii")
        return self

    def _owner(self) -> str:
        try:
            return (self._directory / OWNER).read_text(encoding="ascii").strip() or "unknown"
        except (OSError, UnicodeDecodeError):
            return "unknown"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()
