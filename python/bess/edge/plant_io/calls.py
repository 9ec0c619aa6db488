"""Calls to a plant or a disk, with a deadline that holds even if the other end does not respond.

A link is used by a thread that must not block, so its connections run in a separate event loop. The deadline
cancels a call wherever it waits: for a name server, a handshake, or a slow response. Calls to a disk cannot
be cancelled; they run in a separate thread.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Hashable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, Final, Generic, TypeVar

DEADLINE_S: Final = 3.0
"""Time for reading or writing all strings of a plant."""
CLOSING_TIME_S: Final = 0.5
"""Time to close cancelled calls."""
DISK_DELAY_S: Final = 1.0
"""Time for which a disk may delay its caller."""
CLOCK: Final = time.monotonic
"""Clock by which set-points expire and heartbeats stop."""

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class NotReached(Exception):  # noqa: N818 - of one string, not of the link
    """The call for a string did not begin in time."""


class Stalled(TimeoutError):  # noqa: N818 - of one string, not of the link
    """The call for a string took at least half of the time without an answer."""


class Calls:
    """An event loop in a separate thread."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="plant", daemon=True)
        self._thread.start()

    def __call__(self, call: Coroutine[Any, Any, T], within_s: float) -> T:
        """Return the result of a coroutine; one that has not ended in time is cancelled (TimeoutError)."""
        future = asyncio.run_coroutine_threadsafe(asyncio.wait_for(call, within_s), self._loop)
        try:
            return future.result(within_s + CLOSING_TIME_S)
        except TimeoutError:
            future.cancel()
            raise

    def close(self, last: Coroutine[Any, Any, None]) -> None:
        """Run a last coroutine, which may fail, cancel all others, and end; a second call does nothing.

        The loop ends by itself, so that connections are closed even if it is late.
        """
        if self._closed:
            last.close()
            return
        self._closed = True
        asyncio.run_coroutine_threadsafe(self._end(last), self._loop)
        self._thread.join(DEADLINE_S + CLOSING_TIME_S)

    async def _end(self, last: Coroutine[Any, Any, None]) -> None:
        with suppress(Exception):
            await asyncio.wait_for(last, DEADLINE_S)
        self._loop.stop()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.get_loop().run_forever()


class Rounds(Generic[K, T]):
    """Concurrent calls for all strings within :data:`DEADLINE_S`.

    A string that had no turn in one round is the first in the next, so that all strings of a slow plant are
    served. A call that took half of the time had its turn, so that a string without response does not exclude
    others. A call may raise ``expected``; other exceptions are raised after the round.
    """

    def __init__(self, expected: type[Exception]) -> None:
        self._expected = expected
        self._round = 0
        self._turns: dict[K, int] = {}

    async def __call__(
        self,
        keys: Sequence[K],
        call: Callable[[K], Awaitable[T]],
        turn: Callable[[K], asyncio.Semaphore],
        first: Callable[[K], bool] = lambda key: False,
    ) -> tuple[dict[K, T], dict[K, Exception]]:
        """Return results and errors by key, :class:`TimeoutError` and :class:`NotReached` included.

        ``turn`` limits concurrent calls, ``first`` selects keys that precede all others.
        """
        if not keys:
            return {}, {}
        self._round += 1
        began_s: dict[K, float] = {}
        done: dict[K, T] = {}
        errors: dict[K, Exception] = {}

        async def one(key: K) -> None:
            async with turn(key):
                began_s[key] = time.monotonic()
                try:
                    done[key] = await call(key)
                except Exception as error:
                    errors[key] = error

        order = sorted(keys, key=lambda key: (not first(key), self._turns.get(key, 0)))
        tasks = [asyncio.ensure_future(one(key)) for key in order]
        try:
            _, late = await asyncio.wait(tasks, timeout=DEADLINE_S)
            ended_s = time.monotonic()
            for task in late:
                task.cancel()
            await asyncio.gather(*late, return_exceptions=True)
        finally:
            for task in tasks:  # a round that is given up must not write set-points later
                task.cancel()

        def lateness(key: K) -> Exception:
            if key not in began_s:
                return NotReached()
            return Stalled() if ended_s - began_s[key] > DEADLINE_S / 2.0 else TimeoutError()

        failed = {key: errors.get(key) or lateness(key) for key in order if key not in done}
        for key in order:
            if key in done or key in errors or isinstance(failed[key], Stalled):
                self._turns[key] = self._round
        for error in errors.values():
            if not isinstance(error, self._expected):
                raise error
        return done, failed


class Aside:
    """Runs calls in sequence in a daemon thread of this name."""

    def __init__(self, name: str) -> None:
        self._calls: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._last: Future[Any] | None = None
        self._began_s = 0.0
        threading.Thread(target=self._run, name=name, daemon=True).start()

    @property
    def busy_s(self) -> float:
        """Running time of the last call [s]; 0 if it has ended."""
        return 0.0 if self._last is None or self._last.done() else time.monotonic() - self._began_s

    def __call__(self, call: Callable[[], T]) -> T:
        """Return the result of a call, or raise its exception.

        It is a TimeoutError if the call has not ended within :data:`DISK_DELAY_S` and continues, or if an
        earlier call has not ended and this one was not started.
        """
        if self.busy_s > 0.0:
            raise TimeoutError
        future: Future[T] = Future()
        self._last, self._began_s = future, time.monotonic()
        self._calls.put((future, call))
        return future.result(DISK_DELAY_S)

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
