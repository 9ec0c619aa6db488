"""Writing files so that a crash leaves the old file or the new one, and a full disk a clear message."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bess.errors import BessError, InputError, option

TEMPORARY = ".tmp"
"""What is added to a name while a file is being written."""


@contextmanager
def clear_errors(path: Path) -> Iterator[None]:
    """Turn an operating system error met while writing ``path`` into one sentence that says what is safe.

    Raises
    ------
    BessError
        In place of an ``OSError``: the disk is full, or the path cannot be written.
    """
    try:
        yield
    except OSError as error:
        code = error.errno if error.errno is not None else _errno_in(str(error))
        if code in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise BessError(
                f"{path}: cannot be written ({error.strerror or error}); use another folder"
            ) from error
        full = code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        cause = "the disk is full, make room" if full else f"cannot be written ({error.strerror or error})"
        raise BessError(
            f"{path}: {cause}; everything saved before is intact, continue with {option('resume')}"
        ) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path; on success it is flushed to the disk and takes the place of ``path``."""
    with clear_errors(path), _replacing(path) as temporary:
        yield temporary


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    temporary = path.with_name(path.name + TEMPORARY)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
        sync_directory(path.parent)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file atomically and durably."""
    with clear_errors(path):
        put_bytes(path, content)


def put_bytes(path: Path, content: bytes) -> None:
    """As :func:`write_bytes`, for callers that go on without the file.

    Raises
    ------
    OSError
        If the disk does not take it; what was there before is whole.
    """
    with _replacing(path) as temporary:
        temporary.write_bytes(content)


def folder_in(folder: Path, name: str) -> Path:
    """Return the folder ``name`` in ``folder``; refuse one that is elsewhere, by its name or by a link.

    Raises
    ------
    InputError
        The folder would be elsewhere, or cannot be one for results.
    """
    inside = folder / name
    try:
        elsewhere = inside.resolve().parent != folder.resolve()
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        raise InputError(f"{folder}: is no folder for results ({error}); use another") from error
    if Path(name).name != name or name in ("", ".", "..") or elsewhere:
        raise InputError(f"{folder}: results of {name!r} would be written outside; give another name")
    return inside


def sync_directory(path: Path) -> None:
    """Make the names in a directory durable; Windows does so by itself, and opens no directories."""
    if sys.platform == "win32":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _errno_in(message: str) -> int | None:
    """HDF5 reports the operating system's error number in its text only."""
    _, found, rest = message.partition("errno = ")
    digits = rest.split(",")[0].strip()
    return int(digits) if found and digits.isdigit() else None
