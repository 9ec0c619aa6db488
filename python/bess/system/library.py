"""Bundled components in a system file: ``[battery] cell = "..."`` and ``[inverter] model = "..."``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from bess.system.components.registry import CELL_KEYS, cell_tables, inverter_section
from bess.system.documents import deep_merge


class _Library(NamedTuple):
    key: str
    load: Callable[[str], dict[str, Any]]
    keys: tuple[str, ...]


_LIBRARIES = {
    "battery": _Library("cell", cell_tables, CELL_KEYS),
    "inverter": _Library(
        "model", inverter_section, ("nominal_kw", "load", "loss_charge", "loss_discharge", "off_loss")
    ),
}


def put_over(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` updated with ``override``, with component names replaced by their tables.

    A named component replaces the component of the base; keys beside the name override the component.
    """
    base, override = dict(base), dict(override)
    for section, library in _LIBRARIES.items():
        table = override.get(section)
        if not isinstance(table, Mapping) or library.key not in table:
            continue
        old = base.get(section, {})
        kept = (
            {key: value for key, value in old.items() if key not in library.keys}
            if isinstance(old, Mapping)
            else {}
        )
        base[section] = {**kept, **library.load(table[library.key])}
        override[section] = {key: value for key, value in table.items() if key != library.key}
    return deep_merge(base, override)


def replaced(override: object, section: str, key: str) -> bool:
    """Return whether ``override`` replaces ``key`` of a ``section`` completely."""
    if not isinstance(override, Mapping):
        return False
    library = _LIBRARIES.get(section)
    named = library is not None and library.key in override and key in (library.key, *library.keys)
    value = override.get(key)
    return named or (key in override and not isinstance(value, Mapping))
