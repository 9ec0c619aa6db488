"""Progress on standard error (a bar on a terminal, plain lines elsewhere), and stop requests by signals."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


Update = Callable[[int], None]
"""Receives the number of completed steps."""

_LINE_EVERY_S = 10.0


@contextmanager
def reporting(label: str, total: int, *, shown: bool) -> Iterator[Update]:
    """Yield a function to call after every step."""
    if not shown:
        yield lambda done: None
    elif sys.stderr.isatty():
        with progress_bar(label, total) as (bar, task):
            yield lambda done: bar.update(task, completed=done)
    else:
        yield _lines(label, total)


@contextmanager
def progress_bar(label: str, total: int, *, shown: bool = True) -> Iterator[tuple[Progress, TaskID]]:
    """Yield a bar on standard error, and its only task."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), disable=not shown) as bar:
        yield bar, bar.add_task(label, total=total)


def _lines(label: str, total: int) -> Update:
    started = time.monotonic()
    last = started
    first_done: int | None = None

    def update(done: int) -> None:
        nonlocal last, first_done
        now = time.monotonic()
        first_done = done if first_done is None else first_done
        if now - last < _LINE_EVERY_S and done < total:
            return
        last = now
        rate = (done - first_done) / (now - started) if now > started else 0.0
        left = f", {(total - done) / rate:.0f} s left" if rate > 0.0 and done < total else ""
        print(
            f"{label}: step {done} of {total} ({100.0 * done / total:.0f} %){left}",
            file=sys.stderr,
            flush=True,
        )

    return update


_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_requests() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether a stop was requested; a second signal has its default effect.

    Signals reach the main thread only. In other threads no handler is installed and the function returns
    False.
    """
    requested = False
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    previous = {number: signal.getsignal(number) for number in _SIGNALS}

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        for each, handler in previous.items():
            signal.signal(each, handler)

    for number in _SIGNALS:
        signal.signal(number, note)
    try:
        yield lambda: requested
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
