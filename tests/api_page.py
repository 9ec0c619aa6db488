"""The names that the page of the API lists."""

import importlib
import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "api.rst"


def listed() -> list[str]:
    """Full names on the page, each after the module that is current there."""
    names, module, in_summary = [], "", False
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith(".. currentmodule::"):
            module = line.split("::")[1].strip()
        elif line.startswith(".. py:data::"):
            names.append(f"{module}.{line.split('::')[1].strip()}")
        elif line and not line.startswith(" "):
            in_summary = line.startswith(".. autosummary::")
        elif in_summary and (entry := re.fullmatch(r"   ([A-Za-z_][\w.]*)", line)):
            name = entry[1]
            names.append(name if name.startswith("bess.") else f"{module}.{name}")
    return names


def found(name: str) -> object:
    """What a full name stands for."""
    module, _, attribute = name.rpartition(".")
    return getattr(importlib.import_module(module), attribute)
