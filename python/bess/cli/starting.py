"""A study to start from, in a folder of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bess.errors import InputError
from bess.study.template import template

STUDY: Final = "study.toml"


def start(directory: Path) -> Path:
    """Write ``study.toml`` into a folder, which is made if need be; return its path.

    Raises
    ------
    InputError
        If there is one already: it is not written over.
    """
    path = directory / STUDY
    if path.exists():
        raise InputError(f"{path}: exists already and is not written over; name another folder")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        path.write_text(template(STUDY), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); name another folder") from error
    return path
