"""What comes with the package."""

from __future__ import annotations

from bess._core import ageing_models
from bess.components.registry import Entry, list_cells, list_inverters, list_systems
from bess.policies import POLICIES, plug_ins
from bess.study import bundled_studies, load_study


def listing() -> str:
    """Return all bundled things by kind; systems, cells and inverters with source and licence."""
    kinds = {
        "studies": {name: _with_needs(name, title) for name, title in bundled_studies().items()},
        "systems": {entry.name: _sourced(entry) for entry in list_systems()},
        "cells": {entry.name: _sourced(entry) for entry in list_cells()},
        "inverters": {entry.name: _sourced(entry) for entry in list_inverters()},
        "wear models": _wear_models(),
        "policies": {name: description for name, (_, description) in POLICIES.items()}
        | {name: f"plug-in {point.value}" for name, point in sorted(plug_ins().items())},
    }
    width = max(len(name) for entries in kinds.values() for name in entries)
    indent = "\n" + " " * (width + 4)
    return "\n\n".join(
        "\n".join(
            [
                kind,
                *(f"  {name.ljust(width)}  {text}".replace("\n", indent) for name, text in entries.items()),
            ]
        )
        for kind, entries in kinds.items()
    )


def _wear_models() -> dict[str, str]:
    priced = {
        "none": "nothing wears",
        "throughput": "a price for each MWh discharged (wear.eur_per_mwh); strings stay as they are",
    }
    return priced | dict(ageing_models())


def _with_needs(name: str, title: str) -> str:
    """Title of a study, and what it cannot run without."""
    demand = load_study(name).demand
    needs_prices = demand.kind == "arbitrage" and demand.prices is None
    return f"{title}; needs --set demand.prices=FILE" if needs_prices else title


def _sourced(entry: Entry) -> str:
    return f"{entry.description}\nsource: {entry.source}\nlicence: {entry.licence}"
