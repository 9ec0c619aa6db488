"""Files of a record: atomic writes with clear messages, and checksums."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from bess.errors import BessError, InputError

TEMPORARY = ".tmp"
"""Suffix of a file name during writing."""


RESUME: Final = "continue with resume"
REPEAT: Final = "try again"
"""Remedies, for a run and for what is made anew."""


@contextmanager
def clear_errors(path: Path, remedy: str = RESUME) -> Iterator[None]:
    """Replace an operating system error while writing ``path`` by one sentence with the remedy."""
    try:
        yield
    except OSError as error:
        # HDF5 reports the number of the operating system's error in its text only.
        found = re.search(r"errno = (\d+)", str(error))
        code = int(found[1]) if error.errno is None and found else error.errno
        if code in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise BessError(
                f"{path}: cannot be written ({error.strerror or error}); use another folder"
            ) from error
        full = code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        cause = "the disk is full, make room" if full else f"cannot be written ({error.strerror or error})"
        raise BessError(f"{path}: {cause}; everything saved before is intact, {remedy}") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path; on success it is flushed to the disk and replaces ``path``.

    Raises
    ------
    OSError
        The file cannot be written; an earlier file is unchanged.
    """
    temporary = path.with_name(path.name + TEMPORARY)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
        if sys.platform != "win32":  # which needs no flush of the names, and cannot open folders
            descriptor = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def write_bytes(path: Path, content: bytes, remedy: str = RESUME) -> None:
    """Write a whole file atomically and durably."""
    with clear_errors(path, remedy):
        put_bytes(path, content)


def put_bytes(path: Path, content: bytes) -> None:
    """As :func:`write_bytes`, with the ``OSError``, for callers that continue without the file."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def make_folder(folder: Path) -> set[str]:
    """Create a results folder unless it exists; return the names in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return {path.name for path in folder.iterdir()}
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{folder}: is not a results folder ({reason}); use another output folder"
        ) from error


def folder_in(folder: Path, name: str) -> Path:
    """Return the folder ``name`` in ``folder``; names and links that lead outside are refused."""
    inside = folder / name
    try:
        elsewhere = inside.resolve().parent != folder.resolve()
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        raise InputError(f"{folder}: is not a results folder ({error}); use another") from error
    if Path(name).name != name or name in ("", ".", "..") or elsewhere:
        raise InputError(f"{folder}: results of {name!r} would be written outside; give another name")
    return inside


CHECKSUMS: Final = "SHA256SUMS"


def sha256_of(content: bytes) -> str:
    """Return the checksum of the content of a file."""
    return hashlib.sha256(content).hexdigest()


def sha256(path: Path) -> str:
    """Return the checksum of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_checksums(directory: Path) -> dict[str, str]:
    """Return the checksums of a folder by file name; empty without a checksum file.

    Raises
    ------
    ValueError
        The list is damaged.
    """
    try:
        lines = (directory / CHECKSUMS).read_text(encoding="utf-8").splitlines()
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError) as error:
        raise ValueError(f"{CHECKSUMS} cannot be read: {error}") from error
    pairs = [line.partition("  ") for line in lines]
    return {name: digest for digest, _, name in pairs}


def write_checksums(directory: Path, checksums: Mapping[str, str]) -> None:
    """Write the checksum list of a folder, before its files get their final names."""
    text = "".join(f"{digest}  {name}\n" for name, digest in sorted(checksums.items()))
    write_bytes(directory / CHECKSUMS, text.encode())


def write_checked(path: Path, content: bytes) -> None:
    """Write a file into a folder, and its checksum into the list, if the folder has one."""
    if checksums := read_checksums(path.parent):
        write_checksums(path.parent, checksums | {path.name: sha256_of(content)})
    write_bytes(path, content)


def check_file(path: Path) -> None:
    """Compare a file with its checksum in the folder; a folder without checksums is not checked.

    Raises
    ------
    ValueError
        The file differs from the written content.
    OSError
        The file cannot be read.
    """
    checksums = read_checksums(path.parent)
    if checksums and sha256(path) != checksums.get(path.name):
        raise ValueError(f"its content differs from its checksum in {CHECKSUMS}")


def sealed(body: bytes) -> bytes:
    """Return the content of a self-checking file: a line with the checksum, then the body."""
    return sha256_of(body).encode() + b"\n" + body


def unsealed(content: bytes) -> bytes:
    """Inverse of :func:`sealed`.

    Raises
    ------
    ValueError
        The content differs from the sealed content.
    """
    checksum, _, body = content.partition(b"\n")
    if sha256_of(body).encode() != checksum:
        raise ValueError("its content differs from its checksum")
    return body
