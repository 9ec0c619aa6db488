"""What several tests look at is made once in a session, also among the workers of xdist."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from filelock import FileLock

if TYPE_CHECKING:
    import bess

T = TypeVar("T")


@dataclass(frozen=True)
class Simulated:
    """What tests look at of a run."""

    kpis: dict[str, float]
    starts: float


@dataclass(frozen=True)
class Once:
    """Values by name: the first test that asks for a value makes it, and the others read a copy."""

    folder: Path
    """Folder of this session, which all its workers share."""

    def made(self, name: str, make: Callable[[], T]) -> T:
        path = self.folder / f"{name}.pickle"
        with FileLock(f"{path}.lock"):
            if not path.exists():
                content = pickle.dumps(make())
                path.write_bytes(content)
            made: T = pickle.loads(path.read_bytes())
            return made

    def simulated(self, study: bess.Study) -> Simulated:
        """Simulate a study; one that differs in its name and title only is the same."""
        values = repr(study.model_dump(exclude={"name", "title"}))
        return self.made(hashlib.sha256(values.encode()).hexdigest(), lambda: _simulated(study))


def _simulated(study: bess.Study) -> Simulated:
    import bess

    result = bess.run(study, progress=False)
    return Simulated(dict(result.kpis), float(result.dataset["inverter_starts"].sum()))
