"""Nested documents (TOML tables): reading, merging and error messages."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Self, get_args

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

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


def plain(value: object, place: str = "", depth: int = 0) -> Any:
    """Return a copy of ``value``, which may contain tables, lists, strings and numbers only."""
    if depth > _MAX_DEPTH:
        raise InputError(f"{place[:80]}...: nested deeper than {_MAX_DEPTH} levels")
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item, f"{place}.{key}".lstrip("."), depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, f"{place}[{index}]", depth + 1) for index, item in enumerate(value)]
    if isinstance(value, str | int | float):
        return value
    raise InputError(f"{place or 'document'} = {value!r}: must be a number, a text, a list or a table")


def deep_merge(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` updated with the leaves of ``override``; neither argument is changed."""
    merged = dict(base)
    for key, value in override.items():
        old = merged.get(key)
        merged[key] = (
            deep_merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
        )
    return merged


def describe(found: Sequence[Mapping[str, Any]], model: type[BaseModel], prefix: str = "") -> str:
    """Return one sentence for each validation error, joined by ``; ``: key, value, allowed values.

    ``found`` is from ``ValidationError.errors()`` of ``model``. The sentence of an unknown key names the most
    similar key of the same table.
    """
    problems: dict[str, list[str]] = {}
    places = [_Place.of(problem, model) for problem in found]
    holders = {place.parts[:depth] for place in places for depth in range(len(place.parts))}
    for problem, place in zip(found, places, strict=True):
        if place.parts in holders:
            continue  # from an alternative to the list or table that holds another problem
        message = problem["msg"].removeprefix("Value error, ")
        plain = _PLAIN_WORDS.get(problem["type"])
        message = plain.format(**problem.get("ctx", {})) if plain else message[:1].lower() + message[1:]
        message = message.replace("input should be", "must be", 1)
        key = f"{prefix}{place}".rstrip(".")
        if place.is_unknown:
            message += f"; {place.remedy(key)}"
        else:
            key += _shown(problem["input"])
        problems.setdefault(key, []).append(message)
    sentences = [
        f"{key}: {' or '.join(messages).replace(' or must be ', ' or ')}".removeprefix(": ")
        for key, messages in problems.items()
    ]
    if len(sentences) > _SHOWN_PROBLEMS:
        more = len(sentences) - _SHOWN_PROBLEMS
        sentences[_SHOWN_PROBLEMS:] = [f"and {more} more problem{'s' if more > 1 else ''}"]
    return "; ".join(sentences)


def keys_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a table by their key in a file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


@dataclass(frozen=True)
class _Place:
    """Place in a file; of an unknown key with the models of its table, of the given kind and of all kinds."""

    parts: tuple[str | int, ...]
    is_unknown: bool
    models: list[type[BaseModel]]
    of_all_kinds: list[type[BaseModel]]

    @classmethod
    def of(cls, problem: Mapping[str, Any], model: type[BaseModel]) -> Self:
        """Return the place of an error, without the names that pydantic gives to alternatives."""
        loc, is_unknown = problem["loc"], problem["type"] == "extra_forbidden"
        parts: list[str | int] = []
        models = of_all_kinds = [model]
        for part in loc[:-1] if is_unknown else loc:
            if isinstance(part, int):
                parts.append(part)
            elif fields := [keys_of(each)[part] for each in models if part in keys_of(each)]:
                parts.append(part)
                models = of_all_kinds = [each for field in fields for each in _models(field.annotation)]
            else:
                models = [each for each in models if part in _kinds(each)] or models
        return cls((*parts, *loc[-1:]) if is_unknown else tuple(parts), is_unknown, models, of_all_kinds)

    def __str__(self) -> str:
        path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.parts)
        return path.removeprefix(".")

    def remedy(self, key: str) -> str:
        """Return the kinds that have the unknown key, otherwise the most similar key of the table, or all."""
        unknown = str(self.parts[-1])
        owners = [each for each in self.of_all_kinds if unknown in keys_of(each)]
        if kinds := dict.fromkeys(repr(kind) for owner in owners for kind in _kinds(owner)):
            return f"it is a key of kind {' or '.join(kinds)}"
        allowed = sorted({name for each in self.models for name in keys_of(each)})
        return nearest(unknown, allowed, key.removesuffix(unknown))


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)


def _kinds(model: type[BaseModel]) -> tuple[str, ...]:
    """Return the values of ``kind`` by which a table is chosen; empty without such a key."""
    kind = model.model_fields.get("kind")
    return get_args(kind.annotation) if kind else ()


def _shown(value: object) -> str:
    if isinstance(value, Mapping | list | tuple | type(None)):
        return ""
    try:
        text = value.isoformat() if isinstance(value, date) else repr(value)
    except ValueError:  # an integer with more digits than Python prints
        text = "a very large number"
    return f" = {text if len(text) <= 60 else text[:57] + '...'}"
