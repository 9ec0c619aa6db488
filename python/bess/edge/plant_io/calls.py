"""Calls to a plant, each of which ends in a stated time, whatever is at the other end.

A link is called from a thread that must go on, so its connections live in an event loop of their own: there a
call is cancelled wherever it stands, be it in a name that nobody resolves, a handshake, or an answer that
trickles.
"""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Hashable, Sequence
from contextlib import suppress
from typing import Any, Final, Generic, TypeVar

GRACE_S: Final = 0.5
"""Time to close what was cancelled."""

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class NotReached(Exception):  # noqa: N818 - of one string, not of the link
    """There was no time left to begin with a string."""


class Stalled(TimeoutError):  # noqa: N818 - of one string, not of the link
    """A string had half of the time or more, and no answer came."""


class Calls:
    """An event loop in a thread of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._closed = False
        threading.Thread(target=self._run, name="plant", daemon=True).start()

    def __call__(self, call: Coroutine[Any, Any, T], within_s: float) -> T:
        """Return what a coroutine returns.

        Raises
        ------
        TimeoutError
            It has not ended in time; it is cancelled.
        """
        future = asyncio.run_coroutine_threadsafe(asyncio.wait_for(call, within_s), self._loop)
        try:
            return future.result(within_s + GRACE_S)
        except TimeoutError:
            future.cancel()
            raise

    def close(self, last: Coroutine[Any, Any, None]) -> None:
        """Run one last coroutine, which may fail, and end; a second time does nothing."""
        if self._closed:
            last.close()
            return
        self._closed = True
        with suppress(Exception):
            self(last, GRACE_S)
        self._loop.call_soon_threadsafe(self._loop.stop)

    def _run(self) -> None:
        self._loop.run_forever()
        self._loop.close()


class Rounds(Generic[K, T]):
    """Calls for every string, as many at once as their connection takes, within a time for all of them.

    Who did not have its turn in one round comes first in the next, so that a plant too slow for a round still
    has all of its strings served. Half of the time is a turn, whatever came of it: a string that never
    answers keeps nobody out.

    Parameters
    ----------
    expected
        What a call may raise; anything else is raised again when all have ended.
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
        within_s: float,
        first: Callable[[K], bool] = lambda key: False,
    ) -> tuple[dict[K, T], dict[K, Exception]]:
        """Return what came, and what went wrong: :class:`TimeoutError` and :class:`NotReached` included.

        Parameters
        ----------
        keys
            Of the strings.
        call
            For one of them.
        turn
            What lets some of them through at once.
        within_s
            Time for all.
        first
            Who goes before all others.
        """
        self._round += 1
        began_s: dict[K, float] = {}

        async def one(key: K) -> T:
            async with turn(key):
                began_s[key] = time.monotonic()
                return await call(key)

        order = sorted(keys, key=lambda key: (not first(key), self._turns.get(key, 0)))
        tasks = {key: asyncio.ensure_future(one(key)) for key in order}
        if not tasks:
            return {}, {}
        _, late = await asyncio.wait(tasks.values(), timeout=within_s)
        ended_s = time.monotonic()
        for task in late:
            task.cancel()
        await asyncio.wait(tasks.values())
        done: dict[K, T] = {}
        failed: dict[K, Exception] = {}
        for key, task in tasks.items():
            stalled = task.cancelled() and ended_s - began_s.get(key, math.inf) > within_s / 2.0
            if stalled or not task.cancelled():
                self._turns[key] = self._round
            if task.cancelled():
                failed[key] = Stalled() if stalled else TimeoutError() if key in began_s else NotReached()
            elif isinstance(error := task.exception(), self._expected):
                failed[key] = error
            else:
                done[key] = task.result()
        return done, failed
