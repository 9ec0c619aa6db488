"""Atomic file writes: a crash leaves the old or the new file; a full disk gives a clear message."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bess.errors import BessError, InputError, option

TEMPORARY = ".tmp"
"""Suffix of a file name during writing."""


@contextmanager
def clear_errors(path: Path) -> Iterator[None]:
    """Replace an operating system error while writing ``path`` by one sentence with the remedy.

    Raises
    ------
    BessError
        Replaces an ``OSError``: the disk is full, or the path cannot be written.
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
    """Yield a temporary path; on success it is flushed to the disk and replaces ``path``."""
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
    """As :func:`write_bytes`, for callers that continue without the file.

    Raises
    ------
    OSError
        The file cannot be written; an earlier file is unchanged.
    """
    with _replacing(path) as temporary:
        temporary.write_bytes(content)


def folder_in(folder: Path, name: str) -> Path:
    """Return the folder ``name`` in ``folder``; names and links that lead outside are refused.

    Raises
    ------
    InputError
        The folder is outside ``folder``, or cannot be a results folder.
    """
    inside = folder / name
    try:
        elsewhere = inside.resolve().parent != folder.resolve()
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        raise InputError(f"{folder}: is not a results folder ({error}); use another") from error
    if Path(name).name != name or name in ("", ".", "..") or elsewhere:
        raise InputError(f"{folder}: results of {name!r} would be written outside; give another name")
    return inside


def sync_directory(path: Path) -> None:
    """Flush the names in a directory to the disk; Windows needs no flush and cannot open directories."""
    if sys.platform == "win32":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _errno_in(message: str) -> int | None:
    """Return the operating system's error number, which HDF5 reports in its text only."""
    _, found, rest = message.partition("errno = ")
    digits = rest.split(",")[0].strip()
    return int(digits) if found and digits.isdigit() else None
