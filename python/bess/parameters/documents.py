"""Nested documents (TOML tables): merging them, and saying what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError


def deep_merge(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with the leaves of ``override`` put over it; neither is changed."""
    merged = dict(base)
    for key, value in override.items():
        old = merged.get(key)
        merged[key] = (
            deep_merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
        )
    return merged


def describe(
    error: ValidationError, name: str, *, prefix: str = "", rename: Mapping[str, str] | None = None
) -> str:
    """One sentence for each problem of a validation, joined by ``; ``: file, key, value, what is allowed."""
    rename = rename or {}
    sentences = []
    for problem in error.errors(include_url=False):
        path = ""
        for part in problem["loc"]:
            path += f"[{part}]" if isinstance(part, int) else f".{rename.get(part, part)}"
        key = (prefix + path.lstrip(".")).rstrip(".")
        if problem["type"] == "extra_forbidden":
            sentences.append(f"{key}: unknown key")
            continue
        if problem["type"] == "missing":
            sentences.append(f"{key}: missing")
            continue
        value = problem["input"]
        message = problem["msg"].removeprefix("Value error, ")
        shown = "" if isinstance(value, Mapping | list | tuple | type(None)) else f" = {value!r}"
        sentences.append(f"{key}{shown}: {message[:1].lower() + message[1:]}")
    return f"{name}: " + "; ".join(sentences)
