"""Redirection of solver messages: standard output is reserved for results."""

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
"""File descriptors belong to the whole process."""


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Redirect the standard output of compiled code to standard error.

    Some messages of HiGHS cannot be switched off. The C library buffers them; it is flushed before and after.
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
