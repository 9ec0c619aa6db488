"""A study to start from: the keys that one changes first, and all others in comments."""

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
# A study: which plant, which demand, which policy, and for how long.
#   bess check {name}      checks it and the data it names
#   bess run {name}        runs it; bess report draws the results
# A key in a comment has the value shown, or none, until you set it. bess schema study tells editors as much.
"""
_WIDTH = 34


def template(name: str) -> str:
    """Return the text of a study file; ``name`` is what its first lines call it."""
    blocks = [_HEAD.format(name=name)]
    for header, group in groupby(keys("study"), key=lambda key: key.section):
        blocks.append("\n".join(_block(header, list(group))) + "\n")
    return "\n".join(blocks)


def _block(header: str, group: list[Key]) -> Iterator[str]:
    # Of the kinds of demand the first one is in force; tables that may be repeated are examples.
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
