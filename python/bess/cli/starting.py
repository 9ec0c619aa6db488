"""Creation of a new study file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bess.errors import InputError
from bess.study.template import template

STUDY: Final = "study.toml"


def start(directory: Path) -> Path:
    """Write ``study.toml`` into a folder, created if necessary; return its path.

    Raises
    ------
    InputError
        If the file exists already; it is not overwritten.
    """
    path = directory / STUDY
    if path.exists():
        raise InputError(f"{path}: exists already and is not overwritten; specify another folder")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        path.write_text(template(STUDY), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); specify another folder") from error
    return path
