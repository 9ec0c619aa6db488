"""Nested documents (TOML tables): reading, merging and error messages."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel

from bess.errors import InputError, nearest
from bess.files import parse_toml, read_file

_MAX_DEPTH = 12
_MAX_BYTES = 20 * 2**20
_SHOWN_PROBLEMS = 4
_PLAIN_WORDS = {
    "too_short": "must be a list of at least {min_length}, not of {actual_length}",
    "too_long": "must be a list of at most {max_length}, not of {actual_length}",
    "extra_forbidden": "unknown key",
    "missing": "missing",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_parsing": "must be a whole number",
    "int_type": "must be a whole number",
    "finite_number": "must be a finite number",
    "string_type": "must be a text",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "invalid_key": "keys must be texts",
    "union_tag_invalid": "kind = '{tag}' is unknown; allowed: {expected_tags}",
    "union_tag_not_found": "must be a table",
}


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file, with or without a byte-order mark; every failure is an InputError with the path."""
    raw = read_file(path, _MAX_BYTES)
    try:
        return parse_toml(raw.decode("utf-8-sig").replace("\r\n", "\n"))
    except ValueError as error:  # also an integer of more digits than Python takes
        what = "not valid TOML" if isinstance(error, tomllib.TOMLDecodeError) else "cannot be read"
        raise InputError(f"{path}: {what} ({error})") from error


def plain(value: object, name: str, place: str = "", depth: int = 0) -> Any:
    """Return a copy of ``value``, which may contain tables, lists, strings and numbers only."""
    if depth > _MAX_DEPTH:
        raise InputError(f"{name}: {place[:80]}...: nested deeper than {_MAX_DEPTH} levels")
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {
            str(key): plain(item, name, f"{place}.{key}".lstrip("."), depth + 1)
            for key, item in value.items()
        }
    if isinstance(value, list | tuple):
        return [plain(item, name, f"{place}[{index}]", depth + 1) for index, item in enumerate(value)]
    if isinstance(value, str | int | float):
        return value
    raise InputError(f"{name}: {place} = {value!r}: must be a number, a text, a list or a table")


def deep_merge(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` updated with the leaves of ``override``; neither argument is changed."""
    merged = dict(base)
    for key, value in override.items():
        old = merged.get(key)
        merged[key] = (
            deep_merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
        )
    return merged


def describe(
    found: Sequence[Mapping[str, Any]],
    name: str,
    *,
    prefix: str = "",
    model: type[BaseModel] | None = None,
) -> str:
    """Return one sentence for each validation error, joined by ``; ``: file, key, value, allowed values.

    ``found`` is from ``ValidationError.errors()``. With ``model``, the sentence of an unknown key names the
    most similar key of the same table.
    """
    problems: dict[str, list[str]] = {}
    places = [_without_kinds(problem["loc"]) for problem in found]
    holders = {place[:depth] for place in places for depth in range(len(place))}
    for problem, place in zip(found, places, strict=True):
        if place in holders:
            continue  # from an alternative to the list or table that holds another problem
        unknown = problem["type"] == "extra_forbidden"
        path = ""
        for part in problem["loc"]:
            if isinstance(part, int):
                path += f"[{part}]"
            elif unknown or not _is_kind(part):
                path += f".{part}"
        key = (prefix + path.lstrip(".")).rstrip(".")
        message = problem["msg"].removeprefix("Value error, ")
        plain = _PLAIN_WORDS.get(problem["type"])
        message = plain.format(**problem.get("ctx", {})) if plain else message[:1].lower() + message[1:]
        message = message.replace("input should be", "must be", 1)
        if unknown and model is not None:
            message += _remedy(problem["loc"], model, key)
        problems.setdefault(key + ("" if unknown else _shown(problem["input"])), []).append(message)
    sentences = [
        f"{key}: {' or '.join(messages).replace(' or must be ', ' or ')}".removeprefix(": ")
        for key, messages in problems.items()
    ]
    if len(sentences) > _SHOWN_PROBLEMS:
        more = len(sentences) - _SHOWN_PROBLEMS
        sentences[_SHOWN_PROBLEMS:] = [f"and {more} more problem{'s' if more > 1 else ''}"]
    return f"{name}: " + "; ".join(sentences)


def _remedy(loc: Sequence[str | int], model: type[BaseModel], shown: str) -> str:
    """Return the most similar allowed key of the same table as an unknown key, or all allowed keys."""
    *tables, key = (part for part in loc if isinstance(part, str))
    models = [model]
    for table in tables:
        fields = [
            field
            for each in models
            for name, field in each.model_fields.items()
            if table in (name, field.alias)
        ]
        models = [part for field in fields for part in _parts(field.annotation)]
    allowed = sorted({name for each in models for name in each.model_fields})
    if key not in allowed:
        return f"; {nearest(key, allowed, shown.removesuffix(key))}"
    # Not a typing error, but a key of another kind of demand.
    owners = [each.model_fields["kind"] for each in models if {key, "kind"} <= each.model_fields.keys()]
    kinds = [repr(kind) for owner in owners for kind in get_args(owner.annotation)]
    return f"; it is a key of kind {' or '.join(dict.fromkeys(kinds))}" if kinds else ""


def _parts(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _parts(argument)


def _without_kinds(place: Sequence[str | int]) -> tuple[str | int, ...]:
    return tuple(part for part in place if isinstance(part, int) or not _is_kind(part))


def _is_kind(part: str) -> bool:
    """Return whether a part of a pydantic error location is a type name."""
    return "[" in part or part[:1].isupper()


def _shown(value: object) -> str:
    if isinstance(value, Mapping | list | tuple | type(None)):
        return ""
    try:
        text = value.isoformat() if isinstance(value, date) else repr(value)
    except ValueError:  # an integer with more digits than Python prints
        text = "a very large number"
    return f" = {text if len(text) <= 60 else text[:57] + '...'}"
