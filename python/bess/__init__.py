"""Power split control of multi-string battery storage, in closed loop with an electro-thermal plant.

The public names, listed in ``__init__.pyi``, are loaded on first use, so that ``import bess`` and ``bess
--help`` stay fast.
"""

import ast as _ast
from importlib import import_module as _import_module
from importlib.metadata import version as _version
from pathlib import Path as _Path

_HOMES = {
    alias.name: str(node.module)
    for node in _ast.parse(_Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(node, _ast.ImportFrom)
    for alias in node.names
}
"""Module of each public name."""

__all__ = sorted(_HOMES)
__version__ = _version("bess-powersplit")


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'bess' has no attribute {name!r}")
    value = getattr(_import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
