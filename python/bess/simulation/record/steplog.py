"""``log.jsonl``: a line for each step with a solve or with undelivered energy.

It also contains wall-clock times, which a rerun does not reproduce.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError
from bess.files import parse_json
from bess.simulation.record.atomic import clear_errors
from bess.simulation.record.checksums import check_file

LOG = "log.jsonl"


class StepLog:
    """Appends to the log of a run directory from a byte offset."""

    def __init__(self, directory: Path, offset: int) -> None:
        self._path = directory / LOG
        with clear_errors(self._path):
            self._file = self._path.open("ab")
            self._file.truncate(offset)

    def write(self, lines: Iterable[Mapping[str, Any]]) -> None:
        """Append lines; NaN becomes ``null``."""
        text = "".join(
            json.dumps({key: None if value != value else value for key, value in line.items()}) + "\n"
            for line in lines
        )
        with clear_errors(self._path):
            self._file.write(text.encode())

    def sync(self) -> int:
        """Flush all lines to the disk and return the length of the file [bytes]."""
        with clear_errors(self._path):
            self._file.flush()
            os.fsync(self._file.fileno())
        return self._path.stat().st_size

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with clear_errors(self._path):
            self._file.close()


def solve_times_s(directory: Path) -> NDArray[np.float64]:
    """Return the solve times [s] of all solves in the log.

    Raises
    ------
    InputError
        The log is damaged.
    """
    path = directory / LOG
    if not path.exists():
        return np.zeros(0)
    try:
        check_file(path)
        with path.open(encoding="utf-8") as file:
            times = [parse_json(line)["solve_time_s"] for line in file if line.endswith("\n")]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: is damaged ({error}); delete it to do without the times of solves"
        ) from error
    return np.array([time for time in times if time], dtype=np.float64)
