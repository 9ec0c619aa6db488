"""State that is carried from step to step, and its text in checkpoints."""

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from bess.errors import InputError, listed


class Checkpointed:
    """Base of objects whose attributes named in ``_carried`` are part of a checkpoint; by default none is.

    Attributes that are such objects themselves contribute their own state. ``_classes`` has the class of each
    attribute that is a dataclass or None.
    """

    _carried: ClassVar[tuple[str, ...]] = ()
    _classes: ClassVar[Mapping[str, type]] = {}

    def state_dict(self) -> dict[str, Any]:
        """Return the state between steps, by names without an initial underscore."""
        state = {}
        for name in self._carried:
            value = getattr(self, name)
            if isinstance(value, Checkpointed):
                value = value.state_dict()
            elif name in self._classes and value is not None:
                value = dict(vars(value))
            state[name.lstrip("_")] = value
        return state

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore a state returned by :meth:`state_dict`."""
        names = {name.lstrip("_") for name in self._carried}
        if missing := sorted(names - state_dict.keys()):
            raise InputError(
                f"{type(self).__name__}: no {listed(missing)} in the state; give a result of state_dict"
            )
        for name in self._carried:
            present, value = getattr(self, name), state_dict[name.lstrip("_")]
            if isinstance(present, Checkpointed):
                present.load_state_dict(value)
            elif name in self._classes and value is not None:
                setattr(self, name, self._classes[name](**value))
            else:
                setattr(self, name, value)


_ARRAY, _BYTES = "\0array", "\0bytes"


def to_json(state: Mapping[str, Any]) -> str:
    """Return the text of a state; its leaves are JSON values, ``bytes`` or arrays.

    Raises
    ------
    TypeError
        A leaf is of another type, or a key is a mark of arrays or bytes.
    """
    _check_keys(state)

    def _plain(value: Any) -> Any:
        if isinstance(value, np.ndarray) and value.dtype.kind not in "OV":
            content = b64encode(value.tobytes()).decode()
            return {_ARRAY: content, "dtype": value.dtype.str, "shape": value.shape}
        if isinstance(value, bytes):
            return {_BYTES: b64encode(value).decode()}
        if isinstance(value, Mapping):
            return dict(value)
        if isinstance(value, np.generic):
            return value.item()
        raise TypeError(f"a checkpoint cannot hold {type(value).__name__}")

    return json.dumps(state, default=_plain)


def _check_keys(value: Any) -> None:
    if isinstance(value, Mapping):
        if marks := {_ARRAY, _BYTES} & value.keys():
            raise TypeError(f"a checkpoint cannot hold the key {marks.pop()!r}")
        value = value.values()
    elif not isinstance(value, list | tuple):
        return
    for each in value:
        _check_keys(each)


def from_json(text: str | bytes) -> dict[str, Any]:
    """Return the state of a text, to the last bit; tuples become lists.

    Raises
    ------
    ValueError
        The text is not JSON.
    """

    def restored(table: dict[str, Any]) -> Any:
        if _ARRAY in table:
            values = np.frombuffer(b64decode(table[_ARRAY]), table["dtype"])
            return values.reshape(table["shape"]).copy()
        return b64decode(table[_BYTES]) if _BYTES in table else table

    state: dict[str, Any] = json.loads(text, object_hook=restored)
    return state
