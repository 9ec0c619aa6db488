"""What survives a kill: the controller's memory and its plan, in two files of one folder.

The memory is small and written with every answer, in turn into one of two files, so that a killed process
leaves one of them whole (a rename would be as safe, but makes the disk wait). It is flushed to the disk about
once a second, which is what a loss of power can cost. The plan is written by a rename whenever there is a new
one. The first line of a file is a checksum of the rest.
"""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any, Final

from bess.edge.serve.controller import Controller
from bess.errors import BessError
from bess.simulation.record.aside import Aside
from bess.simulation.record.atomic import put_bytes
from bess.simulation.record.checksums import sealed, sha256_of, unsealed
from bess.system import System

MEMORY: Final = ("memory-0.json", "memory-1.json")
PLAN: Final = "plan.json"
TRIAL: Final = "trial.json"
"""Written and removed at the start, to know at once whether the disk takes anything."""
VERSION: Final = 2
PATIENCE_S: Final = 1.0
"""Time that one writing may hold an answer up."""
HANGS_S: Final = 5.0
"""Time after which a disk that does not answer is an error."""
_FLUSH_S: Final = 1.0


def _made_if_missing(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_CREAT, 0o600)


class StateStore:
    """A folder in which a controller keeps what it must not forget.

    Parameters
    ----------
    folder
        Made if need be.
    system
        Another system's memory is not taken over.

    Attributes
    ----------
    error : str
        Why the state cannot be kept now, in a sentence; empty if it can. The controller goes on without.
    """

    def __init__(self, folder: Path, system: System) -> None:
        self.folder = folder
        self.error = ""
        self._aside = Aside("state")
        self._identity = sha256_of(json.dumps(system.document, sort_keys=True, default=str).encode())
        self._flushed_s = 0.0
        self._number = 0
        self._files: dict[str, FileIO] = {}
        self._saved_plan: object = None

    def load(self, controller: Controller, now_s: float) -> str:
        """Continue where the last process ended; return a sentence on what was found.

        ``now_s`` is the time of the controller's clock. What is damaged, or of another system, is set aside
        under another name, and the controller begins anew.
        """
        fresh = (controller.memory(), controller.plan.memory())
        self._do(lambda: self._try(self._sealed(fresh[0])))
        try:
            memory = self._newest()
            if memory is None:
                return f"no state in {self.folder}; a new one begins"
            plan = self._read(self.folder / PLAN) if (self.folder / PLAN).exists() else None
            controller.recall(memory)
            if plan is not None:
                controller.plan.recall(plan)
        except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, BessError) as error:
            controller.recall(fresh[0])
            controller.plan.recall(fresh[1])
            for name in (*MEMORY, PLAN):
                with suppress(OSError):
                    (self.folder / name).replace(self.folder / f"{name}.damaged")
            return f"the state in {self.folder} cannot be used ({error}); it is set aside, a new one begins"
        age_s = max(0.0, now_s - (memory["_last_s"] or now_s))
        return f"continues with the state in {self.folder}, {age_s:.0f} s old"

    def save(self, controller: Controller) -> None:
        """Write what has changed; a full disk or one that hangs is told by :attr:`error`, not raised."""
        plan = controller.plan.current
        new_plan = None
        if plan is not self._saved_plan:
            new_plan = self._sealed(controller.plan.memory())
        number = self._number + 1
        content = self._sealed({"number": number, **controller.memory()})

        def put() -> None:
            self.folder.mkdir(parents=True, exist_ok=True)
            if new_plan is not None:
                put_bytes(self.folder / PLAN, new_plan)
                self._saved_plan = plan
            self._write(MEMORY[number % 2], content)
            self._number = number

        self._do(put)

    def close(self) -> None:
        """Flush and close the files."""
        self._do(self._close)
        self._aside.close()

    def _do(self, call: Callable[[], None]) -> None:
        """Let the disk do something, and take down what comes of it."""
        try:
            self._aside(call, PATIENCE_S)
            self.error = ""
        except OSError as error:
            if not isinstance(error, TimeoutError):
                self.error = f"{self.folder}: the state cannot be written ({error.strerror or error})"
            elif self._aside.busy_s > HANGS_S:
                self.error = (
                    f"{self.folder}: the disk has not answered for {self._aside.busy_s:.0f} s; "
                    "the state is not written"
                )

    def _try(self, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        put_bytes(self.folder / TRIAL, content)
        (self.folder / TRIAL).unlink()

    def _close(self) -> None:
        for file in self._files.values():
            os.fsync(file.fileno())
            file.close()
        self._files = {}

    def _sealed(self, document: Mapping[str, Any]) -> bytes:
        """A document as the content of a file."""
        body = json.dumps({"version": VERSION, "system": self._identity, **document}).encode()
        return sealed(body)

    def _write(self, name: str, content: bytes) -> None:
        if name not in self._files:
            self._files[name] = FileIO(self.folder / name, "r+", opener=_made_if_missing)
        file = self._files[name]
        file.seek(0)
        if file.write(content) != len(content):
            raise OSError(errno.ENOSPC, "the disk is full")
        file.truncate()
        if time.monotonic() - self._flushed_s > _FLUSH_S:
            os.fsync(file.fileno())
            self._flushed_s = time.monotonic()

    def _newest(self) -> dict[str, Any] | None:
        """The newer of the two files that is whole; None if there are none.

        Raises
        ------
        ValueError
            If there are files and none of them can be used.
        """
        found, problem = [], None
        for name in MEMORY:
            try:
                found.append(self._read(self.folder / name))
            except FileNotFoundError:
                continue
            except (ValueError, KeyError) as error:
                problem = error
        if not found:
            if problem is not None:
                raise problem
            return None
        newest = max(found, key=lambda document: int(document["number"]))
        self._number = int(newest["number"])
        return newest

    def _read(self, path: Path) -> dict[str, Any]:
        try:
            document: dict[str, Any] = json.loads(unsealed(path.read_bytes()))
        except ValueError as error:
            raise ValueError(f"{path.name} is damaged: {error}") from error
        if document["version"] != VERSION:
            raise ValueError(f"{path.name} is of version {document['version']}, not {VERSION}")
        if document["system"] != self._identity:
            raise ValueError(f"{path.name} is of another system")
        return document
