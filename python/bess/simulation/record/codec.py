"""Conversion of a nested dictionary of values and arrays to a flat dictionary of arrays, without loss."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TREE = "tree"
_TABLE, _LIST, _ARRAY, _BYTES, _VALUE = "table", "list", "array", "bytes", "value"

Arrays = Mapping[str, NDArray[Any]]


def pack(document: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Flatten ``document``; its leaves are JSON values, ``bytes`` or arrays.

    The tree is stored as JSON with nodes ``[kind, content]``.
    """
    arrays: dict[str, NDArray[Any]] = {}
    tree = json.dumps(_encoded(document, arrays))
    return {_TREE: np.frombuffer(tree.encode(), dtype=np.uint8), **arrays}


def unpack(arrays: Arrays) -> dict[str, Any]:
    """Inverse of :func:`pack`; tuples become lists."""
    document: dict[str, Any] = _decoded(json.loads(arrays[_TREE].tobytes()), arrays)
    return document


def _encoded(value: Any, arrays: dict[str, NDArray[Any]]) -> list[Any]:
    name = f"array{len(arrays)}"
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return [_ARRAY, name]
    if isinstance(value, bytes):
        arrays[name] = np.frombuffer(value, dtype=np.uint8)
        return [_BYTES, name]
    if isinstance(value, Mapping):
        return [_TABLE, {key: _encoded(entry, arrays) for key, entry in value.items()}]
    if isinstance(value, list | tuple):
        return [_LIST, [_encoded(entry, arrays) for entry in value]]
    return [_VALUE, value.item() if isinstance(value, np.generic) else value]


def _decoded(node: list[Any], arrays: Arrays) -> Any:
    kind, content = node
    if kind == _TABLE:
        return {key: _decoded(entry, arrays) for key, entry in content.items()}
    if kind == _LIST:
        return [_decoded(entry, arrays) for entry in content]
    if kind == _ARRAY:
        return arrays[content]
    return arrays[content].tobytes() if kind == _BYTES else content
