"""State that is carried from step to step, for checkpoints."""

from collections.abc import Mapping
from typing import Any, ClassVar


class Checkpointed:
    """Base of objects whose attributes named in ``_carried`` are part of a checkpoint."""

    _carried: ClassVar[tuple[str, ...]]

    def memory(self) -> dict[str, Any]:
        """Return the carried attributes, by their names without an initial underscore."""
        return {name.lstrip("_"): getattr(self, name) for name in self._carried}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
        for name in self._carried:
            setattr(self, name, memory[name.lstrip("_")])
