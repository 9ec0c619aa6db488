"""Bundled systems, cells and inverters by name. A new one is one data file and one line here.

Every file is a system file or a part of one, with an ``[about]`` table (description, source, licence). A cell
is the cell-level part of a ``[battery]`` section. An inverter is an ``[inverter]`` section, or a ``[sandia]``
table with the coefficients of the CEC list, which is converted to a loss table here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bess.errors import InputError
from bess.files import bundled_toml
from bess.system.components.losses import inverter_from_sandia

SYSTEMS = {
    "reference": "systems/reference.toml",
    "unequal-4": "systems/unequal-4.toml",
    "mixed-4": "systems/mixed-4.toml",
    "m5bat": "systems/m5bat.toml",
    "cornejo-180": "systems/cornejo-180.toml",
}
CELLS = {
    "nmc-reference": "systems/reference.toml",
    "samsung-94ah": "cells/samsung-94ah.toml",
    "sony-lfp-3ah": "cells/sony-lfp-3ah.toml",
}
INVERTERS = {
    "kaco-92": "systems/reference.toml",
    "sinamics-s120": "inverters/sinamics-s120.toml",
    "dynapower-mps-100": "inverters/dynapower-mps-100.toml",
    "princeton-gtib-100": "inverters/princeton-gtib-100.toml",
    "princeton-bigi-250": "inverters/princeton-bigi-250.toml",
    "m5bat-630": "inverters/m5bat-630.toml",
}

INVERTER_KEYS = ("nominal_kw", "load", "loss_charge", "loss_discharge", "off_loss")
CELL_KEYS = (
    "cell_capacity_ah",
    "cell_mass_kg",
    "low_soc_switch",
    "ocv_v",
    "resistance_temperature",
    "resistance_soc",
    "resistance_table",
    "entropy",
)


@dataclass(frozen=True)
class Entry:
    """One bundled component.

    Attributes
    ----------
    name : str
        Name by which files and :func:`bess.load_system` refer to it.
    description, source, licence : str
        Description, source of the data, and licence.
    """

    name: str
    description: str
    source: str
    licence: str


def list_systems() -> tuple[Entry, ...]:
    """Bundled systems."""
    return _entries(SYSTEMS, "description")


def list_cells() -> tuple[Entry, ...]:
    """Bundled cells, for ``[battery] cell = "name"``."""
    return _entries(CELLS, "cell")


def list_inverters() -> tuple[Entry, ...]:
    """Bundled inverters, for ``[inverter] model = "name"``."""
    return _entries(INVERTERS, "inverter")


def system_document(name: str) -> dict[str, Any]:
    """System file of a bundled name, parsed."""
    return _read("system", SYSTEMS, name)


def cell_tables(name: str) -> dict[str, Any]:
    """Cell-level keys of ``[battery]`` of a bundled cell."""
    battery = _read("battery.cell", CELLS, name)["battery"]
    return {key: battery[key] for key in CELL_KEYS if key in battery}


def inverter_section(name: str) -> dict[str, Any]:
    """Section ``[inverter]`` of a bundled inverter."""
    document = _read("inverter.model", INVERTERS, name)
    if "sandia" in document:
        return inverter_from_sandia(**document["sandia"]).section()
    section: dict[str, Any] = document["inverter"]
    return section


def _entries(files: Mapping[str, str], part: str) -> tuple[Entry, ...]:
    abouts = {name: bundled_toml(file)["about"] for name, file in files.items()}
    return tuple(
        Entry(name, about.get(part, about["description"]), about["source"], about["licence"])
        for name, about in abouts.items()
    )


def _read(key: str, files: Mapping[str, str], name: object) -> dict[str, Any]:
    if not isinstance(name, str) or name not in files:
        raise InputError(f"{key} = {name!r}: no such name; bundled are {', '.join(files)} (see `bess list`)")
    return bundled_toml(files[name])
