"""State of the controller's parts that survives a restart, as a JSON document."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ClassVar, TypeVar

import numpy as np

T = TypeVar("T")


class Persistent:
    """Base of objects whose attributes in ``kept`` survive a restart, other such objects included."""

    kept: ClassVar[tuple[str, ...]] = ()

    def state_dict(self) -> dict[str, Any]:
        """Kept attributes as JSON values, independent of this object."""
        return {name: to_json(getattr(self, name)) for name in self.kept}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`.

        Raises
        ------
        KeyError, TypeError, ValueError
            A value is missing or has another shape, for example for another number of strings.
        """
        for name in self.kept:
            setattr(self, name, _restored(getattr(self, name), state_dict[name]))


def to_json(value: Any) -> Any:
    """Value for JSON: arrays as objects with their type, NaN in them as null."""
    if isinstance(value, Persistent):
        return value.state_dict()
    if isinstance(value, np.ndarray):
        entries = value.astype(object)
        entries[value != value] = None
        return {"array": entries.tolist(), "dtype": str(value.dtype)}
    if isinstance(value, Mapping):
        return {key: to_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [to_json(entry) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def from_json(value: Any) -> Any:
    """Inverse of :func:`to_json`."""
    if isinstance(value, dict):
        if value.keys() == {"array", "dtype"}:
            return np.array(value["array"], dtype=value["dtype"])
        return {key: from_json(entry) for key, entry in value.items()}
    return [from_json(entry) for entry in value] if isinstance(value, list) else value


def _restored(present: Any, value: Any) -> Any:
    if isinstance(present, Persistent):
        present.load_state_dict(value)
        return present
    if isinstance(present, list) and present and isinstance(present[0], Persistent):
        return [_restored(each, entry) for each, entry in zip(present, value, strict=True)]
    new = from_json(value)
    if isinstance(present, np.ndarray) and np.shape(new) != present.shape:
        raise ValueError(f"has shape {np.shape(new)}, not {present.shape}")
    return new


def in_pool(pool: ThreadPoolExecutor | None, call: Callable[..., T], *arguments: Any) -> Future[T]:
    """Run a call in a pool, or at once without one."""
    if pool is not None:
        return pool.submit(call, *arguments)
    future: Future[T] = Future()
    future.set_result(call(*arguments))
    return future
