"""A nested dictionary of values and arrays as a flat dictionary of arrays, and back, to the last bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TREE = "tree"


def pack(document: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Flatten ``document``; its leaves are JSON values, ``bytes`` or arrays."""
    arrays: dict[str, NDArray[Any]] = {}

    def keep(kind: str, array: NDArray[Any]) -> dict[str, str]:
        name = f"array{len(arrays)}"
        arrays[name] = array
        return {kind: name}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return keep("__array__", value)
        if isinstance(value, bytes):
            return keep("__bytes__", np.frombuffer(value, dtype=np.uint8))
        if isinstance(value, Mapping):
            return {key: plain(entry) for key, entry in value.items()}
        if isinstance(value, list | tuple):
            return [plain(entry) for entry in value]
        return value.item() if isinstance(value, np.generic) else value

    tree = json.dumps(plain(document))
    return {_TREE: np.frombuffer(tree.encode(), dtype=np.uint8), **arrays}


def unpack(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Inverse of :func:`pack`; tuples come back as lists."""

    def restored(value: dict[str, Any]) -> Any:
        if "__array__" in value:
            return arrays[value["__array__"]]
        if "__bytes__" in value:
            return arrays[value["__bytes__"]].tobytes()
        return value

    document: dict[str, Any] = json.loads(arrays[_TREE].tobytes(), object_hook=restored)
    return document
