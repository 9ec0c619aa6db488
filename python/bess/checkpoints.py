"""State that is carried from step to step, for checkpoints."""

from collections.abc import Mapping
from typing import Any, ClassVar


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
                value = vars(value)
            state[name.lstrip("_")] = value
        return state

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore a state returned by :meth:`state_dict`."""
        for name in self._carried:
            present, value = getattr(self, name), state_dict[name.lstrip("_")]
            if isinstance(present, Checkpointed):
                present.load_state_dict(value)
            elif name in self._classes and value is not None:
                setattr(self, name, self._classes[name](**value))
            else:
                setattr(self, name, value)
