"""Whether what is behind a link still lives: a counter at the plant that has to go on counting."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

STILL_S: Final = 10.0
"""Time without a beat after which a plant that counts seconds counts as lost."""


class Heartbeat:
    """Watches a counter.

    A counter that has never been seen to move is no heartbeat: there are devices that have the register and
    leave it at zero.

    Parameters
    ----------
    clock
        Seconds; never goes back.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._count = math.nan
        self._moved_at_s: float | None = None

    def see(self, count: float) -> None:
        """Take note of the counter; NaN where the plant does not say."""
        if not math.isnan(count) and count != self._count:
            if not math.isnan(self._count):
                self._moved_at_s = self._clock()
            self._count = count

    @property
    def doubt(self) -> str:
        """A sentence if it has stopped; empty while it beats, or if there is none."""
        still_s = 0.0 if self._moved_at_s is None else self._clock() - self._moved_at_s
        if still_s < STILL_S:
            return ""
        return f"its heartbeat has stood at {self._count:.0f} for {still_s:.0f} s; it counts as lost"
