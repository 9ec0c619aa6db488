"""Service log: one JSON object per line, written in a separate thread."""

from __future__ import annotations

import json
import logging
import os
import threading
from contextlib import suppress
from queue import Full, Queue
from typing import Final

from bess.edge.serve.clock import stamp

MOST: Final = 10_000
"""Lines that wait for a reader who has stopped; more are lost."""
_STANDARD_ERROR: Final = 2
LAST_S: Final = 1.0
"""Time for the last lines."""


class Lines(logging.Handler):
    """Writes to standard error from a thread of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(JsonLines())
        self._lines: Queue[str | None] = Queue(MOST)
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Take a line; a full queue loses it."""
        with suppress(Full):
            self._lines.put_nowait(self.format(record))

    def close(self) -> None:
        """Write what is left, if it is read."""
        with suppress(Full):
            self._lines.put_nowait(None)
        self._thread.join(LAST_S)
        super().close()

    def _run(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError):
                # Not by sys.stderr: its lock, held by a thread that cannot write, would abort the exit.
                os.write(_STANDARD_ERROR, f"{line}\n".encode())


class JsonLines(logging.Formatter):
    """One JSON object for each line of the log."""

    def format(self, record: logging.LogRecord) -> str:
        """Time, level, message, and the fields of the record."""
        line = {
            "time": stamp(record.created),
            "level": record.levelname.lower(),
            "message": record.getMessage(),
        }
        line |= getattr(record, "fields", {})
        if record.exc_info:
            line["trace"] = self.formatException(record.exc_info)
        return json.dumps(line)
