"""A run on disk: parts of the record, each with the checkpoint that continues after it, and its log.

A part is one file that is created by a rename. The directory therefore always holds a gap-free record from
step 0 and the state at its end. Steps that were not saved before a crash are computed again on resume. The
first line of a part is a checksum of the rest, which is an ``npz`` archive. ``log.jsonl`` has a line for each
step with a solve or with undelivered energy, with wall-clock times, which a rerun does not reproduce.
"""

from __future__ import annotations

import io
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from bess.checkpoints import from_json, to_json
from bess.errors import InputError
from bess.files import parse_json
from bess.simulation.record.files import check_file, clear_errors, sealed, unsealed, write_bytes

PARTS = "parts"
LOCK = ".lock"
OWNER = ".lock-owner"
_RECORD = "record/"
_CHECKPOINT = "checkpoint"

Record = dict[str, NDArray[Any]]


def joined(records: Sequence[Record]) -> Record:
    """Return the arrays of consecutive records as one record."""
    return {name: np.concatenate([record[name] for record in records]) for name in records[0]}


def write_part(directory: Path, first_step: int, record: Record, checkpoint: Mapping[str, Any]) -> None:
    """Save steps from ``first_step`` on, and the state after them, with one atomic write."""
    arrays = {_RECORD + name: array for name, array in record.items()}
    arrays[_CHECKPOINT] = np.frombuffer(to_json(checkpoint).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    with clear_errors(directory):
        (directory / PARTS).mkdir(exist_ok=True)
    write_bytes(directory / PARTS / f"{first_step:08d}.npz", sealed(buffer.getvalue()))


def parts(directory: Path) -> list[Path]:
    """Files of the parts in the order of their steps; each is named after its first step."""
    return sorted((directory / PARTS).glob("*.npz"))


def read_record(path: Path) -> Record:
    """Return the arrays of a part, with the steps along the first axis; raise InputError if it is damaged."""
    arrays = _arrays(path)
    return {name.removeprefix(_RECORD): arrays[name] for name in arrays if name.startswith(_RECORD)}


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Return the state of the closed loop after a part; raise InputError if the part is damaged."""
    return from_json(_arrays(path)[_CHECKPOINT].tobytes())


def _arrays(path: Path) -> Record:
    try:
        with np.load(io.BytesIO(unsealed(path.read_bytes())), allow_pickle=False) as archive:
            return dict(archive)
    except (OSError, ValueError, MemoryError) as error:
        raise InputError(f"{path}: damaged ({error}); delete it and all later parts, then resume") from error


def records(directory: Path) -> Iterator[tuple[int, Record]]:
    """Yield the first step and the arrays of each part, with one part in memory at a time."""
    step = 0
    for path in parts(directory):
        if int(path.stem) != step:
            raise InputError(
                f"{path}: the part before it, from step {step} on, is missing; delete it and all later "
                f"parts, then resume"
            )
        record = read_record(path)
        yield step, record
        step += len(record["demand_kw"])


def remove_parts(directory: Path) -> None:
    """Delete the parts, newest first, so that the record remains gap-free after a crash."""
    for path in reversed(parts(directory)):
        path.unlink()
    shutil.rmtree(directory / PARTS, ignore_errors=True)


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Lock a run directory against a second process; the system releases the lock even after ``kill -9``.

    A second file names the owner, because some systems do not allow reading a locked file.
    """
    lock, owner = FileLock(directory / LOCK), directory / OWNER
    with clear_errors(directory / LOCK):
        try:
            lock.acquire(timeout=0)
        except Timeout as error:
            process = "unknown"
            with suppress(OSError, UnicodeDecodeError):
                process = owner.read_text(encoding="ascii").strip() or process
            raise InputError(
                f"{directory}: another process ({process}) writes there; wait, or use another folder"
            ) from error
    try:
        with suppress(OSError):  # a full disk: the lock is still valid
            owner.write_text(str(os.getpid()), encoding="ascii")
        yield
    finally:
        lock.release()


LOG = "log.jsonl"


def append_log(directory: Path, offset: int, lines: Iterable[Mapping[str, Any]]) -> int:
    """Replace the log from a byte offset on by lines; NaN becomes ``null``. Return its length [bytes]."""
    text = "".join(
        json.dumps({key: None if value != value else value for key, value in line.items()}) + "\n"
        for line in lines
    )
    path = directory / LOG
    with clear_errors(path), path.open("ab") as file:
        file.truncate(offset)
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())
        return os.fstat(file.fileno()).st_size


def solve_times_s(directory: Path) -> dict[int, float]:
    """Return the solve times [s] of all solves in the log, by step."""
    path = directory / LOG
    if not path.exists():
        return {}
    try:
        check_file(path)
        with path.open(encoding="utf-8") as file:
            lines = [parse_json(line) for line in file if line.endswith("\n")]
        return {int(line["step"]): float(line["solve_time_s"]) for line in lines if line["solve_time_s"]}
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(
            f"{path}: is damaged ({error}); delete it to do without the times of solves"
        ) from error
