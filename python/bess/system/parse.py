"""System documents to validated sections of every string."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import Field, ValidationError

from bess.errors import InputError, nearest
from bess.system.battery import Battery
from bess.system.components.registry import CELL_KEYS, INVERTER_KEYS, cell_tables, inverter_section
from bess.system.cooling import Cooling
from bess.system.documents import deep_merge, describe, keys_of
from bess.system.section import Section
from bess.system.sections import About, Control, Derating, Inverter, SystemDefaults, Thermal, Wear

_T = TypeVar("_T", bound=Section)

PER_STRING_SITE = (
    "initial_soc",
    "initial_temperature_c",
    "initial_soh_capacity",
    "initial_soh_resistance",
)
COMPONENTS: dict[str, tuple[str, Callable[[str], dict[str, Any]], tuple[str, ...]]] = {
    "battery": ("cell", cell_tables, CELL_KEYS),
    "inverter": ("model", inverter_section, INVERTER_KEYS),
}
"""Sections in which a name selects a bundled component: key of the name, its tables, keys they replace."""


class StringParameters(Section):
    """All sections of one string."""

    site: SystemDefaults = Field(alias="system")
    battery: Battery
    inverter: Inverter
    derating: Derating
    thermal: Thermal
    wear: Wear = Wear()

    def table(self) -> dict[str, Any]:
        """Return the sections as a ``[[string]]`` table."""
        tables = self.model_dump(by_alias=True, exclude_none=True)
        tables["system"] = {key: tables["system"][key] for key in PER_STRING_SITE}
        return tables

    def core_document(self) -> dict[str, Any]:
        """Return the parameters of a string for the compiled core."""
        ageing = {"model": self.wear.cell_model, "calendar_share": self.wear.calendar_share}
        return {**self.model_dump(exclude={"site", "wear"}), "ageing": ageing}


class PlantSections(Section):
    """Sections of the whole plant."""

    about: About | None = None
    cooling: Cooling | None = None
    control: Control = Control()


STRING_SECTIONS = keys_of(StringParameters)
"""Sections that a ``[[string]]`` table may override, by their name in a file."""


def parse_system(document: Mapping[str, Any]) -> tuple[tuple[StringParameters, ...], PlantSections]:
    """Validate a document; return the sections of every string and those of the whole plant."""
    check_layout(document)
    overrides = document.get("string", [])
    site = document.get("system", {})
    whole = {key: document[key] for key in PlantSections.model_fields if key in document}
    plant = _validated(PlantSections, whole)
    n_strings = string_count(document)
    whole_site = {**site, "n_strings": n_strings}
    if len(overrides) > n_strings:
        raise InputError(f"{len(overrides)} [[string]] tables for system.n_strings = {n_strings}")

    base = {key: document.get(key, {}) for key in STRING_SECTIONS} | {"system": whole_site}
    without_table = n_strings - len(overrides)
    alike = [_string({}, base, "")] * without_table if without_table else []
    strings = []
    for index, override in enumerate(overrides):
        place = f"string[{index}]."
        if unknown := sorted(set(override) - set(STRING_SECTIONS)):
            raise InputError(f"{place}{unknown[0]}: unknown section; {nearest(unknown[0], STRING_SECTIONS)}")
        _check_single(override, place)
        own_site = override.get("system", {})
        if isinstance(own_site, Mapping) and (misplaced := sorted(set(own_site) - set(PER_STRING_SITE))):
            raise InputError(
                f"{place}system.{misplaced[0]}: not a key of one string; "
                + nearest(misplaced[0], PER_STRING_SITE)
            )
        strings.append(_string(base, override, place))
    return (*strings, *alike), plant


def check_layout(document: object) -> None:
    """Raise :class:`InputError` unless ``document`` consists of sections of a system file."""
    if not isinstance(document, Mapping):
        raise InputError(f"a system is a table of sections, not {type(document).__name__}")
    known = {*STRING_SECTIONS, *PlantSections.model_fields, "string"}
    if unknown := sorted(set(document) - known):
        homes = [
            section
            for section, field in STRING_SECTIONS.items()
            if unknown[0] in getattr(field.annotation, "model_fields", ())
        ]
        remedy = f"it is a key of section {homes[0]!r}" if homes else nearest(unknown[0], sorted(known))
        raise InputError(f"unknown section {unknown[0]!r}; {remedy}")
    overrides = document.get("string", [])
    if not isinstance(overrides, list) or not all(isinstance(entry, Mapping) for entry in overrides):
        raise InputError("string: write one [[string]] table for each string")
    _check_single(document, "")
    for section in (*STRING_SECTIONS, *PlantSections.model_fields):
        if not isinstance(document.get(section, {}), Mapping):
            raise InputError(f"{section}: must be a table")


def _check_single(document: Mapping[str, Any], place: str) -> None:
    """Raise :class:`InputError` where several batteries or inverters are given for a string."""
    for section in ("battery", "inverter"):
        if isinstance(document.get(section), list):
            raise InputError(
                f"{place}{section}: a string is one battery behind one inverter, not a list of "
                f"{len(document[section])}; combine alike ones to one table "
                "(docs/howto/own-system.md, Several inverters or batteries)"
            )


def string_count(document: Mapping[str, Any]) -> int:
    """Return the number of strings: ``system.n_strings``, otherwise the number of string tables."""
    whole_site = {"n_strings": len(document.get("string", [])) or 1, **document.get("system", {})}
    return _validated(SystemDefaults, whole_site, "system.").n_strings


def put_over(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` updated with ``override``, with component names replaced by their tables.

    A named component replaces the component of the base; further keys override those of the component.
    """
    base, override = dict(base), dict(override)
    for section, (key, tables, keys) in COMPONENTS.items():
        table, old = override.get(section), base.get(section, {})
        if isinstance(table, Mapping) and key in table:
            kept = {k: v for k, v in old.items() if k not in keys} if isinstance(old, Mapping) else {}
            base[section] = {**kept, **tables(table[key])}
            override[section] = {k: v for k, v in table.items() if k != key}
    return deep_merge(base, override)


def replaced(override: object, section: str, key: str) -> bool:
    """Return whether ``override`` replaces ``key`` of a ``section`` completely."""
    if not isinstance(override, Mapping):
        return False
    named, _, keys = COMPONENTS.get(section, (None, None, ()))
    if named in override and key in (named, *keys):
        return True
    return key in override and not isinstance(override[key], Mapping)


def _string(base: Mapping[str, Any], override: Mapping[str, Any], place: str) -> StringParameters:
    try:
        sections = put_over(put_over({}, base), override)
    except InputError as error:
        raise InputError(f"{place}{error}") from error
    return _validated(StringParameters, sections, place)


def _validated(kind: type[_T], table: object, prefix: str = "") -> _T:
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise InputError(describe(error.errors(), kind, prefix)) from error
