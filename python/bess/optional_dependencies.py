"""Optional libraries and the messages for missing ones."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from bess.errors import InputError

Extra = Literal["report", "sweep", "market", "plant", "distil"]


@contextmanager
def extra(name: Extra, purpose: str) -> Iterator[None]:
    """Import a module of an extra; ``purpose`` begins the error message if it is not installed."""
    try:
        yield
    except ImportError as error:
        library = (error.name or "").partition(".")[0]
        if library == "bess":
            raise
        # pandas names no module where Parquet has no engine.
        missing = f"{library}, which is not installed" if library else "a library that is not installed"
        raise InputError(f"{purpose} needs {missing}; pip install 'bess-powersplit[{name}]'") from error
