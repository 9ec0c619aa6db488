"""The system a study runs on: a file or bundled name with the study's changes put over it."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bess.components.registry import SYSTEMS, system_document
from bess.errors import InputError
from bess.parameters import System
from bess.parameters.documents import deep_merge, plain, read_toml
from bess.parameters.library import put_over, replaced
from bess.parameters.parse import PER_STRING_SITE, check_layout, string_count
from bess.study.keys import check_bundled
from bess.study.sections import RunChoice, SystemChoice, WearChoice


def build_system(
    choice: SystemChoice, run: RunChoice, wear: WearChoice, given: System | None = None
) -> System:
    """Return the system as the study wants it; ``given`` takes the place of the file that it names.

    Raises
    ------
    InputError
        From the system file, or a list of initial values that is not one for each string.
    """
    name = choice.file if given is None else given.name
    document = _document(choice.file) if given is None else copy.deepcopy(given.document)
    check_layout(document, name)
    parameters = plain(choice.parameters, "system.parameters")
    check_layout(parameters, "system.parameters")
    _check_reach(document, parameters, name)
    try:
        document = put_over(put_over({}, document), parameters)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    site: dict[str, Any] = dict(document.get("system", {}))
    strings = [dict(entry) for entry in document.get("string", [])]
    n_strings = choice.n_strings or string_count(document, name)
    if choice.n_strings is not None or strings:
        site["n_strings"] = n_strings
    if choice.ambient_c is not None:
        site["ambient_c"] = choice.ambient_c
    for key in PER_STRING_SITE:
        value = getattr(choice, key)
        if value is None:
            continue
        values = list(value) if isinstance(value, tuple) else [value] * n_strings
        if len(values) != n_strings:
            raise InputError(f"system.{key}: {len(values)} values for {n_strings} strings")
        strings += [{} for _ in range(n_strings - len(strings))]
        for index, number in enumerate(values):
            strings[index] = deep_merge(strings[index], {"system": {key: number}})
    document["system"] = site
    if strings:
        document["string"] = strings
    if chosen := wear.model_dump(exclude_none=True):
        document["wear"] = {**document.get("wear", {}), **chosen}
    if run.plant_step_s is not None:
        document["control"] = {**document.get("control", {}), "plant_step_s": run.plant_step_s}
    return System(document, name=name)


def _document(file: str) -> dict[str, Any]:
    check_bundled("system.file", file, SYSTEMS)
    return system_document(file) if file in SYSTEMS else read_toml(Path(file))


def _check_reach(document: Mapping[str, Any], parameters: Mapping[str, Any], name: str) -> None:
    """Refuse parameters of the study that no string has, because each has a value of its own."""
    strings = document.get("string", [])
    if "string" in parameters or len(strings) < string_count(document, name):
        return
    for section, table in parameters.items():
        for key in table if isinstance(table, Mapping) else ():
            if all(replaced(entry.get(section), section, key) for entry in strings):
                raise InputError(
                    f"system.parameters.{section}.{key}: every string of {name} has its own; "
                    "give [[system.parameters.string]] tables, one for each string"
                )
