"""Listing of bundled components."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from bess._core import ageing_models
from bess.control.policies import POLICIES, plug_ins
from bess.errors import InputError
from bess.study import bundled_studies, load_study
from bess.system.components.registry import Entry, list_cells, list_inverters, list_systems


def listing(words: Sequence[str] = ()) -> str:
    """Return bundled entries by kind; systems, cells and inverters with source and licence.

    Parameters
    ----------
    words
        Optional kind first (:data:`KINDS`, or its singular); the name or text of each returned entry
        contains every other word, ignoring case.

    Raises
    ------
    InputError
        If no entry contains all words.
    """
    kind = next((kind for kind in KINDS if words and kind.startswith(_stem(words[0]))), None)
    wanted = [word.casefold() for word in (words if kind is None else words[1:])]
    found: dict[str, dict[str, str]] = {}
    for name, make in KINDS.items():
        if kind in (None, name):
            things = make().items()
            chosen = {k: v for k, v in things if all(word in f"{k} {v}".casefold() for word in wanted)}
            found |= {name: chosen} if chosen else {}
    if not found:
        raise InputError(
            f"bess list {' '.join(words)}: no entry contains {' and '.join(map(repr, wanted))}; omit words, "
            f"or start with a kind: {', '.join(KINDS)}"
        )
    width = max(len(name) for entries in found.values() for name in entries)
    indent = "\n" + " " * (width + 4)
    return "\n\n".join(
        "\n".join(
            [
                kind,
                *(f"  {name.ljust(width)}  {text}".replace("\n", indent) for name, text in entries.items()),
            ]
        )
        for kind, entries in found.items()
    )


def _stem(word: str) -> str:
    """Return a kind without its plural ending; very short words stay as they are."""
    stem = word.casefold().removesuffix("s").removesuffix("ie").removesuffix("y")
    return stem if len(stem) > 2 else word


def _wear_models() -> dict[str, str]:
    priced = {
        "none": "no ageing",
        "throughput": "a price per MWh discharged (wear.eur_per_mwh), without capacity loss",
    }
    return priced | dict(ageing_models())


def _with_needs(name: str, title: str) -> str:
    """Return the title of a study with its required inputs."""
    demand = load_study(name).demand
    needs_prices = demand.kind == "arbitrage" and demand.prices is None
    return f"{title}; needs --set demand.prices=FILE" if needs_prices else title


def _sourced(entry: Entry) -> str:
    return f"{entry.description}\nsource: {entry.source}\nlicence: {entry.licence}"


KINDS: Final[Mapping[str, Callable[[], dict[str, str]]]] = {
    "studies": lambda: {name: _with_needs(name, title) for name, title in bundled_studies().items()},
    "systems": lambda: {entry.name: _sourced(entry) for entry in list_systems()},
    "cells": lambda: {entry.name: _sourced(entry) for entry in list_cells()},
    "inverters": lambda: {entry.name: _sourced(entry) for entry in list_inverters()},
    "wear models": _wear_models,
    "policies": lambda: (
        {name: description for name, (_, description) in POLICIES.items()}
        | {name: f"plug-in {point.value}" for name, point in sorted(plug_ins().items())}
    ),
}
"""Contents of ``bess list`` by kind: texts by name."""
