"""A clock for control: it starts at the time of day and then never jumps."""

from __future__ import annotations

import time
from datetime import UTC, datetime


class Clock:
    """Seconds since 1970, taken once from the clock of the machine and then counted by its monotonic one."""

    def __init__(self) -> None:
        self._offset_s = time.time() - time.monotonic()

    def __call__(self) -> float:
        """Time now [s]."""
        return time.monotonic() + self._offset_s


def stamp(now_s: float) -> str:
    """Time as text, UTC."""
    return datetime.fromtimestamp(now_s, tz=UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
