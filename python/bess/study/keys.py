"""Dotted keys of a study: known keys, assignment and suggestions for typos."""

from __future__ import annotations

import copy
import difflib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from bess.errors import InputError
from bess.files import parse_toml

Document = dict[str, Any]
_ANY = "*"
_DEEPEST = 12


def known_keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Return the dotted keys of ``model``; ``*`` stands for any name or index of a table."""
    for name, field in model.model_fields.items():
        key = prefix + name
        parts = list(_parts(field.annotation))
        sections = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
        if not sections or float in parts:
            yield key
        if not sections and dict in parts:
            yield f"{key}.{_ANY}"
        for section in sections:
            yield from known_keys(section, f"{key}.{_ANY}." if tuple in parts else f"{key}.")


def check_keys(document: Mapping[str, Any], model: type[BaseModel], place: str) -> None:
    """Raise :class:`InputError` for the first unknown key of ``document``."""
    known = sorted(set(known_keys(model)))
    for key in _leaves(document, ""):
        if not any(_matches(key, pattern) for pattern in known):
            names = [pattern for pattern in known if _ANY not in pattern]
            close = difflib.get_close_matches(key, names, n=1, cutoff=0.5)
            raise InputError(f"{place}: {key}: unknown key; {nearest(key, close or _beside(key, known))}")


def _beside(key: str, known: Iterable[str]) -> list[str]:
    """Return the keys and tables in the deepest existing table of ``key``."""
    names = [pattern.partition(f".{_ANY}")[0] for pattern in known]
    path = key.split(".")[:-1]
    while path and not any(name.startswith(".".join(path) + ".") for name in names):
        path.pop()
    depth = len(path)
    inside = [name.split(".") for name in names if name.split(".")[:depth] == path]
    return sorted({".".join(parts[: depth + 1]) for parts in inside})


def nearest(name: str, names: list[str]) -> str:
    """Return the suggestion of an error message: the closest name, or all names."""
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"allowed: {', '.join(names)}"


def check_bundled(key: str, name: str, bundled: Iterable[str]) -> None:
    """Refuse a name that is not bundled and not a path: a path has a folder or an extension.

    Raises
    ------
    InputError
        The name is refused; the message gives the most similar bundled name.
    """
    if name not in bundled and not Path(name).suffix and Path(name).name == name:
        raise InputError(f"{key} = {name!r}: no bundled item has this name; {nearest(name, list(bundled))}")


def value_at(document: object, key: str) -> Any:
    """Return the value of a dotted key, in which a number is an index of a list; None without one."""
    for part in key.split("."):
        if isinstance(document, list | tuple):
            document = dict(zip(map(str, range(len(document))), document, strict=True))
        document = document.get(part) if isinstance(document, Mapping) else None
    return document


def with_value(document: Mapping[str, Any], key: str, value: Any) -> Document:
    """Return a copy of ``document`` in which the dotted ``key`` has ``value``; an index addresses a list.

    Raises
    ------
    InputError
        The key has more dots than any.
    """
    changed = copy.deepcopy(dict(document))
    node: Any = changed
    *path, last = key.split(".")
    if len(path) > _DEEPEST:
        raise InputError(f"{key[:80]}...: unknown key; no key has more than {_DEEPEST} dots")
    for part in path:
        node = _child(node, part, key)
    if isinstance(node, list):
        node[_index(node, last, key)] = value
    else:
        node[last] = value
    return changed


def parse_assignment(text: str) -> tuple[str, Any]:
    """Split ``key=value``; the value is TOML, and any other word is a text.

    Raises
    ------
    InputError
        The text has no ``=``, or its value looks like TOML but is not valid.
    """
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
    if not isinstance(child, dict | list):
        raise InputError(f"{key}: {part} = {child!r} has no keys below it")
    return child


def _index(node: list[Any], part: str, key: str) -> int:
    if part.isdigit() and int(part) < len(node):
        return int(part)
    raise InputError(f"{key}: {part!r} is no index of a list of {len(node)} entries (from 0)")


def _leaves(node: Any, prefix: str) -> Iterator[str]:
    if isinstance(node, Mapping) and (node or not prefix):
        for name, value in node.items():
            yield from _leaves(value, f"{prefix}.{name}" if prefix else str(name))
    elif isinstance(node, list) and node and all(isinstance(entry, Mapping) for entry in node):
        for index, entry in enumerate(node):
            yield from _leaves(entry, f"{prefix}.{index}")
    else:
        yield prefix


def _matches(key: str, pattern: str) -> bool:
    """Whether ``key`` is the pattern, a section above it, or below a free table."""
    parts, wanted = key.split("."), pattern.split(".")
    if wanted[-1] == _ANY and len(parts) >= len(wanted):
        parts = parts[: len(wanted)]
    return len(parts) <= len(wanted) and all(
        want in (_ANY, part) for part, want in zip(parts, wanted, strict=False)
    )


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation, the generic type of it, and the same of its arguments."""
    yield from (annotation, get_origin(annotation))
    for argument in get_args(annotation):
        yield from _parts(argument)
