"""Keep a solver's own prints off standard output, which belongs to the results."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_STDOUT = 1
_STDERR = 2
_alone = threading.Lock()
"""The descriptors are those of the whole process."""


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Send what compiled code prints to standard output to standard error instead.

    HiGHS has prints that no option silences. The C library buffers them, so it is flushed on both ends.
    """
    with _alone:
        try:
            kept = os.dup(_STDOUT)
        except OSError:  # no standard output at all
            yield
            return
        try:
            _flush()
            os.dup2(_STDERR, _STDOUT)
            yield
        finally:
            _flush()
            os.dup2(kept, _STDOUT)
            os.close(kept)


def _flush() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
