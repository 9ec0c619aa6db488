"""State on disk that survives a kill: the controller's memory and its plan.

The memory is small and written with every answer, alternately to two files, so that a killed process leaves
one of them intact (a rename would be as safe, but makes the disk wait). It is flushed about once a second,
which is the loss with a power failure. A new plan is written by a rename. The first line of a file is a
checksum of the rest.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any, Final

from bess.checkpoints import from_json, to_json
from bess.edge.plant_io.calls import Aside
from bess.edge.serve import LOG
from bess.edge.serve.controller import Controller
from bess.errors import BessError
from bess.simulation.record.dataset import fingerprint
from bess.simulation.record.files import put_bytes, sealed, unsealed
from bess.system import System

MEMORY: Final = ("memory-0.json", "memory-1.json")
PLAN: Final = "plan.json"
TRIAL: Final = "trial.json"
"""Written and removed at the start, to test the disk."""
VERSION: Final = 9
DISK_TIMEOUT_S: Final = 5.0
"""Time after which a disk without response is an error."""
_FLUSH_S: Final = 1.0


class StateStore:
    """State of a controller in a folder, valid for one system.

    ``error`` is the present failure of the disk, in a sentence; the controller continues without the disk.
    """

    def __init__(self, folder: Path, system: System) -> None:
        self.folder = folder
        self.error = ""
        self._aside = Aside("state")
        self._identity = fingerprint(system)
        self._flushed_s = 0.0
        self._number = 0
        self._files: dict[str, FileIO] = {}
        self._saved_plan: object = None

    def load(self, controller: Controller, now_s: float) -> str:
        """Restore the state of the last process; log and return a sentence on the result.

        ``now_s`` is the time of the controller's clock. A damaged state, or that of another system, is
        renamed, and the controller begins with a new one.
        """
        fresh = (controller.state_dict(), controller.plan.state_dict())
        self._do(lambda: self._try(self._sealed(fresh[0])))
        try:
            state_dict = self._newest()
            note = f"no state in {self.folder}; a new one begins"
            if state_dict is not None:
                controller.load_state_dict(state_dict)
                if (self.folder / PLAN).exists():
                    controller.plan.load_state_dict(self._read(self.folder / PLAN))
                age_s = max(0.0, now_s - (state_dict["last_s"] or now_s))
                note = f"continues with the state in {self.folder}, {age_s:.0f} s old"
            LOG.info(note)
        except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, BessError) as error:
            controller.load_state_dict(fresh[0])
            controller.plan.load_state_dict(fresh[1])
            for name in (*MEMORY, PLAN):
                with suppress(OSError):
                    (self.folder / name).replace(self.folder / f"{name}.damaged")
            note = f"the state in {self.folder} cannot be used ({error}); it is set aside, a new one begins"
            LOG.warning(note)
        return note

    def save(self, controller: Controller) -> None:
        """Write the state; a failure of the disk is reported by :attr:`error`, not raised."""
        plan = controller.plan.current
        new_plan = None
        if plan is not self._saved_plan:
            new_plan = self._sealed(controller.plan.state_dict())
        number = self._number + 1
        content = self._sealed({"number": number, **controller.state_dict()})

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
        """Run an operation on the disk and record its failure."""
        try:
            self._aside(call)
            self.error = ""
        except OSError as error:
            if not isinstance(error, TimeoutError):
                self.error = f"{self.folder}: the state cannot be written ({error.strerror or error})"
            elif self._aside.busy_s > DISK_TIMEOUT_S:
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
        return sealed(to_json({"version": VERSION, "system": self._identity, **document}).encode())

    def _write(self, name: str, content: bytes) -> None:
        if name not in self._files:
            (self.folder / name).touch(0o600)
            self._files[name] = FileIO(self.folder / name, "r+")
        file = self._files[name]
        file.seek(0)
        if file.write(content) != len(content):
            raise OSError(errno.ENOSPC, "the disk is full")
        file.truncate()
        if time.monotonic() - self._flushed_s > _FLUSH_S:
            os.fsync(file.fileno())
            self._flushed_s = time.monotonic()

    def _newest(self) -> dict[str, Any] | None:
        """The newer intact file of both; None without files, ValueError if none is intact."""
        found, problem = [], None
        for path in (self.folder / name for name in MEMORY):
            if path.exists():
                try:
                    found.append(self._read(path))
                except (ValueError, KeyError) as error:
                    problem = error
        if problem is not None and not found:
            raise problem
        newest = max(found, key=lambda document: int(document["number"]), default=None)
        self._number = 0 if newest is None else int(newest["number"])
        return newest

    def _read(self, path: Path) -> dict[str, Any]:
        try:
            document = from_json(unsealed(path.read_bytes()))
        except ValueError as error:
            raise ValueError(f"{path.name} is damaged: {error}") from error
        if document["version"] != VERSION:
            raise ValueError(f"{path.name} is of version {document['version']}, not {VERSION}")
        if document["system"] != self._identity:
            raise ValueError(f"{path.name} is of another system")
        return document
