"""State that is carried from step to step, for checkpoints."""

from collections.abc import Mapping
from typing import Any, ClassVar


class Checkpointed:
    """Base of objects whose attributes named in ``_carried`` are part of a checkpoint; by default none is.

    Attributes that are such objects themselves contribute their own state.
    """

    _carried: ClassVar[tuple[str, ...]] = ()

    def state_dict(self) -> dict[str, Any]:
        """Return the state between steps, by names without an initial underscore."""
        values = {name.lstrip("_"): getattr(self, name) for name in self._carried}
        return {
            name: value.state_dict() if isinstance(value, Checkpointed) else value
            for name, value in values.items()
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore a state returned by :meth:`state_dict`."""
        for name in self._carried:
            present, value = getattr(self, name), state_dict[name.lstrip("_")]
            if isinstance(present, Checkpointed):
                present.load_state_dict(value)
            else:
                setattr(self, name, value)
