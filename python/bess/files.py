"""Safe reading of input files: no pipes, devices, oversized files or excessive nesting."""

from __future__ import annotations

import difflib
import json
import os
import stat
import tomllib
from collections.abc import Callable
from functools import partial
from importlib import resources
from io import BufferedIOBase
from os import PathLike
from pathlib import Path
from typing import IO, Any, Final, Literal

from bess.errors import InputError

Fill = Literal["previous", "interpolate", "previous_day"]
"""How gaps of more than an hour are filled: last value, straight line, values of the day before."""

MAX_BYTES: Final = 200 * 2**20
"""Maximum size of a file, packed or unpacked: about 50 years of quarter hours."""

_MAX_DEPTH: Final = 64
"""Maximum nesting of tables and lists; no file of the package comes near it."""


class MissingFileError(InputError):
    """The file does not exist."""


def missing(path: str | Path) -> str:
    """Return the remedy for a missing file: the most similar name in its folder, if any."""
    where = Path(path)
    try:
        close = difflib.get_close_matches(where.name, [each.name for each in where.parent.iterdir()], 1, 0.8)
    except FileNotFoundError:
        return f"check the path, there is no folder {where.parent}"
    except OSError:
        close = []
    return f"did you mean {close[0]!r}?" if close else "check the path"


def path_of(path: str | PathLike[str], kind: str = "file") -> Path:
    """Return the path of a file or folder.

    Raises
    ------
    InputError
        The argument is neither a text nor a path, or is empty.
    """
    if not isinstance(path, str | PathLike) or isinstance(os.fspath(path), bytes):
        raise InputError(f"a {kind} is named by a text or a path, not by {type(path).__name__}")
    if not os.fspath(path):
        raise InputError(f"a {kind} is named by an empty text; give its path")
    return Path(path)


class RepeatedKeyError(ValueError):
    """A key occurs twice in one object."""


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON document; every failure is a ValueError, excessive nesting included.

    Raises
    ------
    ValueError
        The text is not JSON, or is nested too deeply; :class:`RepeatedKeyError` for a key that occurs twice
        in one object.
    """
    return _parsed(partial(json.loads, object_pairs_hook=_object), text)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for key, value in pairs:
        if key in entries:
            raise RepeatedKeyError(f"the key {key!r:.80} occurs twice in one object; give it once")
        entries[key] = value
    return entries


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML document; see :func:`parse_json`.

    Raises
    ------
    ValueError
        The text is not TOML, or is nested too deeply.
    """
    document: dict[str, Any] = _parsed(tomllib.loads, text)
    return document


def bundled_toml(name: str) -> dict[str, Any]:
    """Parse a file of the package by its path in ``bess/data``."""
    return tomllib.loads((resources.files("bess.data") / name).read_text("utf-8"))


def _parsed(parse: Callable[[Any], Any], text: str | bytes) -> Any:
    """Convert a RecursionError of the parser, or of a later traversal, to a ValueError."""
    try:
        document = parse(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    level = [[document]]
    for _ in range(_MAX_DEPTH):
        nodes = [entry for entries in level for entry in entries if isinstance(entry, dict | list)]
        if not nodes:
            return document
        level = [list(node.values()) if isinstance(node, dict) else node for node in nodes]
    raise ValueError(f"is nested deeper than {_MAX_DEPTH} levels")


def read_file(path: str | PathLike[str], largest: int = MAX_BYTES) -> bytes:
    """Return the content of a file."""
    place = path_of(path)
    try:
        kind = place.stat().st_mode
        if not stat.S_ISREG(kind):
            found = "folder" if stat.S_ISDIR(kind) else "pipe or a device"
            raise InputError(f"{path}: cannot be read (a {found}, not a file); give a file")
        with place.open("rb") as file:
            return limited(file, place, largest)
    except InputError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise MissingFileError(f"{path}: no such file; {missing(place)}") from None
    except (OSError, ValueError) as error:  # a path with a NUL in it is a ValueError
        cause = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({cause}); check the path and its permissions") from None


def limited(file: IO[bytes] | BufferedIOBase, path: str | Path, largest: int = MAX_BYTES) -> bytes:
    """Return the rest of an open file; raise InputError beyond ``largest`` bytes."""
    raw = file.read(largest + 1)
    if len(raw) > largest:
        size = f"{largest // 2**20} MiB"
        raise InputError(f"{path}: holds more than {size}; cut it down to the columns and the period needed")
    return raw
