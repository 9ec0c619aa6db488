"""Checksums of the files of a finished run, in the format of ``sha256sum``."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from bess.simulation.record.atomic import write_bytes

CHECKSUMS: Final = "SHA256SUMS"


def sha256_of(content: bytes) -> str:
    """Return the checksum of the content of a file."""
    return hashlib.sha256(content).hexdigest()


def sha256(path: Path) -> str:
    """Return the checksum of a file.

    Raises
    ------
    OSError
        As :func:`open` does.
    """
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
        raise ValueError(f"is not what was written, by its checksum in {CHECKSUMS}")


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
        raise ValueError("is not what was written, by its checksum")
    return body
