"""Dotted keys of a study: their values and assignment, and names of bundled items."""

import copy
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bess.errors import InputError, nearest
from bess.files import parse_toml

_MAX_DEPTH = 12


def check_bundled(key: str, name: str, bundled: Iterable[str]) -> None:
    """Raise InputError for a name that is neither bundled nor a path, which has a folder or an extension."""
    if name not in bundled and not Path(name).suffix and Path(name).name == name:
        raise InputError(f"{key} = {name!r}: no bundled item has this name; {nearest(name, list(bundled))}")


def dotted(key: str) -> str:
    """Return a key with its indices as parts: ``event.0.string`` for ``event[0].string``."""
    return re.sub(r"\[(\d+)\]", r".\1", key)


def value_at(document: object, key: str) -> Any:
    """Return the value of a dotted key, in which a number is an index of a list; None without one."""
    for part in key.split("."):
        if isinstance(document, list | tuple):
            document = {str(index): entry for index, entry in enumerate(document)}
        document = document.get(part) if isinstance(document, Mapping) else None
    return document


def with_value(document: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Return a copy of ``document`` in which the dotted ``key`` has ``value``; see :func:`dotted`."""
    changed = copy.deepcopy(dict(document))
    node: Any = changed
    *path, last = dotted(key).split(".")
    if len(path) > _MAX_DEPTH:
        raise InputError(f"{key[:80]}...: unknown key; no key has more than {_MAX_DEPTH} dots")
    for part in path:
        node = _child(node, part, key)
    if isinstance(node, list):
        node[_index(node, last, key)] = value
    else:
        node[last] = value
    return changed


def parse_assignment(text: str) -> tuple[str, Any]:
    """Split ``key=value``; the value is TOML, and any other word is a text."""
    key, found, raw = text.partition("=")
    key, raw = key.strip(), raw.strip()
    if not found or not key or not raw:
        raise InputError(f"--set {text!r}: write key=value, for example --set policy.horizon_steps=4")
    try:
        return key, parse_toml(f"value = {raw}")["value"]
    except ValueError as error:
        if raw[0] in "[{\"'":
            raise InputError(f"--set {text!r}: {raw} is not a TOML value ({error})") from error
        return key, raw


def _child(node: Any, part: str, key: str) -> Any:
    if isinstance(node, list):
        return node[_index(node, part, key)]
    child = node.setdefault(part, {})
    if isinstance(child, tuple):  # as in a study, which is immutable
        child = node[part] = list(child)
    if not isinstance(child, dict | list):
        raise InputError(f"{key}: {part} = {child!r} has no keys below it")
    return child


def _index(node: list[Any], part: str, key: str) -> int:
    if part.isdigit() and int(part) < len(node):
        return int(part)
    raise InputError(f"{key}: {part!r} is no index of a list of {len(node)} entries (from 0)")
