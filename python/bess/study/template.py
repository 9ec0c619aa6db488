"""Template of a study file: common keys set, all other keys as comments."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Final

from bess.study.reference import Key, keys

_CHOSEN: Final = {
    "title": '"My first study"',
    "system.file": '"reference"',
    "demand.file": '"two-cycle-48h"',
    "demand.repeat": "true",
    "policy.name": '"mpc"',
    "run.days": "2",
}
_HEAD = """\
# A study defines the plant, the demand, the policy and the period.
#   bess check {name}      validates the study and its data
#   bess run {name}        runs the study; bess report writes a report
# Keys in comments show their defaults. bess schema study provides the same information to editors.
"""
_WIDTH = 34


def template(name: str) -> str:
    """Return the text of a study file; its header refers to the file as ``name``."""
    blocks = [_HEAD.format(name=name)]
    for header, group in groupby(keys("study"), key=lambda key: key.section):
        blocks.append("\n".join(_block(header, list(group))) + "\n")
    return "\n".join(blocks)


def _block(header: str, group: list[Key]) -> Iterator[str]:
    # Only the first kind of demand is active; repeatable tables are examples.
    table, _, kind = header.partition(" ")
    live = any(key.key in _CHOSEN for key in group) and kind in ("", 'kind = "profile"')
    if table:
        yield table if live else f"# {table}"
    for key in group:
        name = key.key.removeprefix(table.strip("[]") + ".")
        chosen = _CHOSEN.get(key.key) if live else None
        default = "" if key.default in ("required", "name of the file") else key.default
        line = f"{name} = {chosen}" if chosen else f"# {name} = {default}"
        about = [
            key.meaning,
            f"[{key.unit}]" if key.unit else "",
            f"Allowed: {key.allowed}." if key.allowed else "",
        ]
        yield f"{line.ljust(_WIDTH)} # {' '.join(filter(None, about))}"
