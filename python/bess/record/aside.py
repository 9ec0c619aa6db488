"""Work on a disk that may hang: done aside, and waited for no longer than is said."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")


class Aside:
    """Runs one call after the other in a thread that does not keep the process from ending.

    Parameters
    ----------
    name
        Of the thread.
    """

    def __init__(self, name: str) -> None:
        self._calls: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._last: Future[Any] | None = None
        self._began_s = 0.0
        threading.Thread(target=self._run, name=name, daemon=True).start()

    @property
    def busy_s(self) -> float:
        """For how long the last call has been under way [s]; 0 if it has ended."""
        return 0.0 if self._last is None or self._last.done() else time.monotonic() - self._began_s

    def __call__(self, call: Callable[[], T], within_s: float) -> T:
        """Return what a call returns, or raise what it raises.

        Raises
        ------
        TimeoutError
            It has not ended in time, and goes on; or one before it has not, and it was not begun.
        """
        if self.busy_s > 0.0:
            raise TimeoutError
        future: Future[T] = Future()
        self._last, self._began_s = future, time.monotonic()
        self._calls.put((future, call))
        return future.result(within_s)

    def close(self) -> None:
        """End the thread once it has nothing to do."""
        self._calls.put(None)

    def _run(self) -> None:
        while (work := self._calls.get()) is not None:
            future, call = work
            try:
                future.set_result(call())
            except BaseException as error:
                future.set_exception(error)
