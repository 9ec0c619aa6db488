"""What survives a kill: the controller's memory and its plan, in two files of one folder.

The memory is small and written with every answer, in turn into one of two files, so that a killed process
leaves one of them whole (a rename would be as safe, but makes the disk wait). It is flushed to the disk about
once a second, which is what a loss of power can cost. The plan is written by a rename whenever there is a new
one. The first line of a file is a checksum of the rest.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from bess.errors import BessError, InputError
from bess.parameters import System
from bess.record.atomic import write_bytes
from bess.serve.controller import Controller

MEMORY: Final = ("memory-0.json", "memory-1.json")
PLAN: Final = "plan.json"
VERSION: Final = 1
_FLUSH_S: Final = 1.0


class Memory:
    """A folder in which a controller keeps what it must not forget.

    Parameters
    ----------
    folder
        Made if need be.
    system
        Another system's memory is not taken over.

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """

    def __init__(self, folder: Path, system: System) -> None:
        self.folder = folder
        self.error = ""
        self._identity = hashlib.sha256(
            json.dumps(system.document, sort_keys=True, default=str).encode()
        ).hexdigest()
        self._flushed_s = 0.0
        self._number = 0
        self._files: dict[str, int] = {}
        self._saved_plan: object = None
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            raise InputError(f"--state {folder}: is no folder that can be written to ({error})") from error

    def load(self, controller: Controller, now_s: float) -> str:
        """Continue where the last process ended; return a sentence on what was found.

        ``now_s`` is the time of the controller's clock. What is damaged, or of another system, is set aside
        under another name, and the controller begins anew.
        """
        fresh = (controller.memory(), controller.plan.memory())
        try:
            memory = self._newest()
            if memory is None:
                return f"no state in {self.folder}; a new one begins"
            plan = self._read(self.folder / PLAN) if (self.folder / PLAN).exists() else None
            controller.recall(memory)
            if plan is not None:
                controller.plan.recall(_arrays(plan))
        except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, BessError) as error:
            controller.recall(fresh[0])
            controller.plan.recall(fresh[1])
            for name in (*MEMORY, PLAN):
                if (self.folder / name).exists():
                    (self.folder / name).replace(self.folder / f"{name}.damaged")
            return f"the state in {self.folder} cannot be used ({error}); it is set aside, a new one begins"
        age_s = max(0.0, now_s - (controller.memory()["last_s"] or now_s))
        return f"continues with the state in {self.folder}, {age_s:.0f} s old"

    def save(self, controller: Controller) -> None:
        """Write what has changed; a full disk or the like is told by :attr:`error`, not raised."""
        durable = time.monotonic() - self._flushed_s > _FLUSH_S
        try:
            if controller.plan.current is not self._saved_plan:
                write_bytes(self.folder / PLAN, self._sealed(_plain(controller.plan.memory())))
                self._saved_plan = controller.plan.current
            self._number += 1
            content = self._sealed({"number": self._number, **controller.memory()})
            self._write(MEMORY[self._number % 2], content, durable=durable)
            self.error = ""
        except OSError as error:
            self.error = f"{self.folder}: the state cannot be written ({error.strerror or error})"
        except BessError as error:
            self.error = str(error)
        if durable:
            self._flushed_s = time.monotonic()

    def close(self) -> None:
        """Flush and close the files."""
        for descriptor in self._files.values():
            os.fsync(descriptor)
            os.close(descriptor)
        self._files = {}

    def _sealed(self, document: Mapping[str, Any]) -> bytes:
        """A document as the content of a file."""
        body = json.dumps({"version": VERSION, "system": self._identity, **document}).encode()
        return hashlib.sha256(body).hexdigest().encode() + b"\n" + body

    def _write(self, name: str, content: bytes, *, durable: bool) -> None:
        if name not in self._files:
            self._files[name] = os.open(self.folder / name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        descriptor = self._files[name]
        written = os.pwrite(descriptor, content, 0)
        if written != len(content):
            raise OSError(errno.ENOSPC, "the disk is full")
        os.ftruncate(descriptor, written)
        if durable:
            os.fsync(descriptor)

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
        checksum, _, body = path.read_bytes().partition(b"\n")
        if hashlib.sha256(body).hexdigest().encode() != checksum:
            raise ValueError(f"{path.name} is damaged")
        document: dict[str, Any] = json.loads(body)
        if document["version"] != VERSION:
            raise ValueError(f"{path.name} is of version {document['version']}, not {VERSION}")
        if document["system"] != self._identity:
            raise ValueError(f"{path.name} is of another system")
        return document


def _plain(value: Any) -> Any:
    """Arrays as tables that name them."""
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "dtype": str(value.dtype)}
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def _arrays(value: Any) -> Any:
    """Inverse of :func:`_plain`."""
    if isinstance(value, dict):
        if value.keys() == {"array", "dtype"}:
            return np.array(value["array"], dtype=value["dtype"])
        return {key: _arrays(entry) for key, entry in value.items()}
    return [_arrays(entry) for entry in value] if isinstance(value, list) else value
