"""Reading a whole file that someone else named: never a pipe that hangs, never a device without an end."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Final, Literal, Protocol

from bess.errors import InputError

Fill = Literal["previous", "interpolate", "previous_day"]
"""How gaps of more than an hour are filled: last value, straight line, values of the day before."""

LARGEST_BYTES: Final = 200 * 2**20
"""What is read of a file or unpacked from an archive at most: some 50 years of quarter hours."""


def read_file(path: str | Path, largest: int = LARGEST_BYTES) -> bytes:
    """Return the content of a file.

    Raises
    ------
    InputError
        It is a pipe or a device, or holds more than ``largest`` bytes.
    OSError, ValueError
        As :func:`open` does.
    """
    kind = Path(path).stat().st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
        raise InputError(f"{path}: cannot be read (a pipe or a device, not a file); give a file")
    with Path(path).open("rb") as file:
        return limited(file, path, largest)


class _Readable(Protocol):
    def read(self, size: int, /) -> bytes: ...


def limited(file: _Readable, path: str | Path, largest: int = LARGEST_BYTES) -> bytes:
    """Return what is left of an open file; raise InputError if that is more than ``largest`` bytes.

    Raises
    ------
    InputError
        There is more than the largest size.
    """
    raw = file.read(largest + 1)
    if len(raw) > largest:
        size = f"{largest // 2**20} MiB"
        raise InputError(f"{path}: holds more than {size}; cut it down to the columns and the period needed")
    return raw
