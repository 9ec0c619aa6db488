"""Disk operations in a separate thread with a time-out, because a disk may hang."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")


class Aside:
    """Runs calls in sequence in a daemon thread.

    Parameters
    ----------
    name
        Name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._calls: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._last: Future[Any] | None = None
        self._began_s = 0.0
        threading.Thread(target=self._run, name=name, daemon=True).start()

    @property
    def busy_s(self) -> float:
        """Running time of the last call [s]; 0 if it has ended."""
        return 0.0 if self._last is None or self._last.done() else time.monotonic() - self._began_s

    def __call__(self, call: Callable[[], T], within_s: float) -> T:
        """Return the result of a call, or raise its exception.

        Raises
        ------
        TimeoutError
            The call has not ended in time and continues; or an earlier call has not ended and this call was
            not started.
        """
        if self.busy_s > 0.0:
            raise TimeoutError
        future: Future[T] = Future()
        self._last, self._began_s = future, time.monotonic()
        self._calls.put((future, call))
        return future.result(within_s)

    def close(self) -> None:
        """End the thread after its last call."""
        self._calls.put(None)

    def _run(self) -> None:
        while (work := self._calls.get()) is not None:
            future, call = work
            try:
                future.set_result(call())
            except BaseException as error:
                future.set_exception(error)
