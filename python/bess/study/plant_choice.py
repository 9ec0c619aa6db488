"""System and policy settings of a study, with its overrides in place."""

from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

from bess.control.policies import Settings
from bess.errors import InputError, placed
from bess.study.keys import check_bundled
from bess.study.sections import RunSection, SystemSection, WearSection
from bess.study.study import Study
from bess.system import System
from bess.system.components.registry import SYSTEMS, system_document
from bess.system.documents import deep_merge, plain, read_toml
from bess.system.parse import PER_STRING_SITE, check_layout, put_over, replaced, string_count
from bess.system.system import check_system


def build_system(
    choice: SystemSection, run: RunSection, wear: WearSection, given: System | None = None
) -> System:
    """Return the system of a study; ``given`` replaces the file of the study."""
    if given is not None:
        check_system(given)
    name = choice.file if given is None else given.name
    document = _document(choice.file) if given is None else given.document
    with placed("system.parameters"):
        parameters = plain(choice.parameters)
        check_layout(parameters)
    with placed(name):
        check_layout(document)
        _check_reach(document, parameters)
        document = put_over(put_over({}, document), parameters)
        n_strings = choice.n_strings or string_count(document)
    site, strings = document.setdefault("system", {}), document.get("string", [])
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
        own = [{"system": {key: number}} for number in values]
        strings = [deep_merge(*pair) for pair in zip_longest(strings, own, fillvalue=dict[str, Any]())]
    if strings:
        document["string"] = strings
    if chosen := wear.model_dump(exclude_none=True):
        document["wear"] = {**document.get("wear", {}), **chosen}
    if run.plant_step_s is not None:
        document["control"] = {**document.get("control", {}), "plant_step_s": run.plant_step_s}
    with placed("system.parameters" if parameters else ""):
        return System(document, name=name)


def _document(file: str) -> dict[str, Any]:
    check_bundled("system.file", file, SYSTEMS)
    return system_document(file) if file in SYSTEMS else read_toml(Path(file))


def _check_reach(document: Mapping[str, Any], parameters: Mapping[str, Any]) -> None:
    """Raise for parameters without effect, because every string overrides them."""
    strings = document.get("string", [])
    if "string" in parameters or len(strings) < string_count(document):
        return
    for section, table in parameters.items():
        for key in table if isinstance(table, Mapping) else ():
            if all(replaced(entry.get(section), section, key) for entry in strings):
                raise InputError(
                    f"system.parameters.{section}.{key}: every string has its own value; "
                    "set it in [[system.parameters.string]] tables, one per string"
                )


def policy_settings(study: Study, system: System) -> Settings:
    """Return the settings of the study's policy for its system."""
    return Settings(
        dt_h=system.control.dt_h,
        horizon_steps=study.policy.steps_ahead(system.control),
        policy=study.policy,
        terms=study.settlement,
        reactive=study.reactive is not None,
    )
