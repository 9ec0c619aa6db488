"""Studies: definition of closed-loop runs, read from TOML and validated."""

import re
import unicodedata
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import ModelWrapValidatorHandler, ValidationError, model_validator

from bess.control.policies.settings import PolicySection
from bess.display import as_table, one_line
from bess.errors import InputError, nearest
from bess.files import MissingFileError, bundled_toml, missing
from bess.study.demands import DEMAND_KINDS, TRADES, Demand, kind_of_demand
from bess.study.keys import dotted, value_at, with_value
from bess.study.sections import (
    Augmentation,
    Axis,
    BudgetSection,
    ContractSection,
    Event,
    OutputSection,
    ReactiveSection,
    Replacement,
    RunName,
    RunSection,
    Scenario,
    ServiceSection,
    SystemSection,
    WearSection,
    WeatherSection,
)
from bess.system.documents import describe, read_toml
from bess.system.section import PublicSection
from bess.system.terms import SettlementTerms

_FILES = (
    "system.file",
    "policy.file",
    "reactive.file",
    "weather.file",
    *dict.fromkeys(f"demand.{key}" for kind in DEMAND_KINDS.values() for key in kind.files),
)
"""Keys of file names. A name without folder and suffix refers to a bundled item."""
_SOURCES = ("file", "frequency", "load", "pv", "prices")
"""Keys of a demand that are shown in its description."""


class Study(PublicSection):
    """A study file with all defaults filled in and all paths absolute. Immutable.

    Read one with :func:`bess.load_study`; change one with :meth:`with_values`.
    """

    name: RunName
    title: str = ""
    system: SystemSection = SystemSection()
    demand: Demand
    reactive: ReactiveSection | None = None
    weather: WeatherSection = WeatherSection()
    policy: PolicySection = PolicySection()
    settlement: SettlementTerms = SettlementTerms()
    wear: WearSection = WearSection()
    budget: BudgetSection = BudgetSection()
    contract: ContractSection = ContractSection()
    run: RunSection = RunSection()
    output: OutputSection = OutputSection()
    service: ServiceSection = ServiceSection()
    event: tuple[Event, ...] = ()
    replacement: tuple[Replacement, ...] = ()
    augmentation: tuple[Augmentation, ...] = ()
    scenario: tuple[Scenario, ...] = ()
    sweep: tuple[Axis, ...] = ()

    @property
    def refinements(self) -> int:
        """How often a search adds runs (:func:`bess.study.scenarios.refined`); 0 without a search."""
        return max((axis.refine or 0 for axis in self.sweep), default=0)

    @model_validator(mode="wrap")
    @classmethod
    def _choose_objectives(cls, document: Any, validate: ModelWrapValidatorHandler[Self]) -> Self:
        """Fill in the default objectives, which depend on the demand; they remain marked as not given."""
        policy, objectives = (value_at(document, key) for key in ("policy", "policy.objectives"))
        policy, objectives = ({} if each is None else each for each in (policy, objectives))
        tables = all(isinstance(each, Mapping) for each in (document, policy, objectives))
        if not tables or objectives.get("kind") is not None:
            return validate(document)
        certified = policy.get("mode") == "certified" or policy.get("foresight_h") == 0
        plans = not certified and policy.get("horizon_steps") is None
        kind = "money" if plans and kind_of_demand(document.get("demand")) in TRADES else "energy"
        study = validate({**document, "policy": {**policy, "objectives": {**objectives, "kind": kind}}})
        study.policy.objectives.model_fields_set.discard("kind")
        return study

    @model_validator(mode="after")
    def _check_budget(self) -> Self:
        if self.budget.is_set and self.demand.kind not in TRADES:
            raise ValueError(
                f'budget: demand.kind = "{self.demand.kind}" does not trade; a budget applies to '
                + " and ".join(TRADES)
            )
        return self

    @classmethod
    def from_document(cls, document: Mapping[str, Any], place: str) -> Self:
        """Validate a study given as nested dictionaries; errors refer to ``place``.

        Raises
        ------
        InputError
            With place, key, value and allowed range.
        """
        try:
            study = cls.model_validate(document)
        except ValidationError as error:
            raise InputError(f"{place}: {describe(error.errors(), cls)}") from error
        try:
            study.to_toml().encode()
        except (TypeError, ValueError) as error:  # None; no UTF-8; thousands of digits
            raise InputError(f"{place}: cannot be written as a study file ({error}); correct it") from error
        return study

    def with_values(self, values: Mapping[str, Any]) -> Self:
        """Return this study with dotted keys set, checked again; paths are relative to the working folder.

        Raises
        ------
        InputError
            An unknown key, a whole section in place of one key, or a value out of range.
        """
        if not isinstance(values, Mapping):
            raise InputError(f"values must be a table of keys, not {type(values).__name__}")
        if not values:
            return self
        document = self.model_dump(exclude_unset=True, exclude_none=True)
        for key, value in zip(map(str, values), values.values(), strict=True):
            if "." not in key and isinstance(value, Mapping):
                raise InputError(f"{key}: give one key of this section, such as {key}.NAME = VALUE")
            document = with_value(document, key, value.item() if isinstance(value, np.number) else value)
        document = _with_absolute_paths(document, Path.cwd())
        return self.from_document(document, self.name)

    def _facts(self) -> dict[str, str]:
        demand = self.demand.model_dump(exclude_none=True)
        facts = {
            "name": self.name,
            "title": self.title,
            "system": self.system.file,
            "demand": " ".join(filter(None, [demand["kind"], *(demand.get(key) for key in _SOURCES)])),
            "policy": self.policy.name,
        }
        if self.run.days is not None:
            facts["days"] = f"{self.run.days:g}"
        tables = {"events": self.event, "scenarios": self.scenario, "sweep axes": self.sweep}
        return facts | {name: str(len(table)) for name, table in tables.items() if table}

    __repr__ = __str__ = one_line
    _repr_html_ = as_table

    def document(self) -> dict[str, Any]:
        """The study as nested dictionaries, without keys that are not set."""
        return self.model_dump(exclude_none=True)

    def to_toml(self) -> str:
        """The study as resolved, as a study file."""
        import tomli_w

        return tomli_w.dumps(self.document())


def bundled_studies() -> dict[str, str]:
    """Return the names of the bundled studies with their titles."""
    return {name: _bundled(name).get("title", "") for name in _bundled_names()}


def _bundled_names() -> list[str]:
    files = [each.name for each in (resources.files("bess.data") / "studies").iterdir()]
    return sorted(file.removesuffix(".toml") for file in files if file.endswith(".toml"))


def _bundled(name: str) -> dict[str, Any]:
    return bundled_toml(f"studies/{name}.toml")


def load_study(name: str | Path, values: Mapping[str, Any] | None = None) -> Study:
    """Read a study by its bundled name (``case1``, ``case2``, ...) or from a TOML file.

    Parameters
    ----------
    name
        Bundled name or path. Relative paths inside the file are relative to the file.
    values
        Dotted keys that override those of the file, such as ``{"run.days": 7}``.

    Raises
    ------
    InputError
        File not found, not TOML, an unknown key (with the nearest one), or a value out of range.
    """
    if not isinstance(name, str | Path):
        raise InputError(f"a study is a bundled name or a path, not {type(name).__name__}")
    path, bundled = Path(name), _bundled_names()
    if str(name) in bundled:
        document = {"name": str(name), **_bundled(str(name))}
    else:
        try:
            document = {"name": _name_from(path), **read_toml(path)}
        except MissingFileError:
            hint = nearest(path.name, bundled) if not path.suffix else missing(path)
            raise InputError(f"{path}: no such study; {hint}") from None
        document = _with_absolute_paths(document, path.resolve().parent)
    return Study.from_document(document, str(name)).with_values(values or {})


def as_study(study: Study | str | Path) -> Study:
    """Return a study, given as :class:`Study`, or as :func:`load_study` takes it."""
    return study if isinstance(study, Study) else load_study(study)


def _name_from(path: Path) -> str:
    """Return the default name of a study: its file name with characters valid for a folder."""
    letters = unicodedata.normalize("NFKD", path.stem).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9._=+-]+", "-", letters).strip("-._=+")[:100] or "study"


def names_file(key: str) -> bool:
    """Whether the value of a dotted key is the name of a file."""
    return re.sub(r"\.\d+\.", ".*.", dotted(key)) in _FILES


def _with_absolute_paths(node: Any, folder: Path, key: str = "") -> Any:
    """Resolve the files that a study names, also in its scenarios and axes, against ``folder``.

    ``key`` is the dotted key of ``node``. Bundled names stay as they are.
    """
    if isinstance(node, Mapping):
        prefix = "" if key in ("", "scenario.*.set") else f"{key}."
        keys = {name: f"{prefix}{name}" for name in node}
        if key == "sweep.*":
            keys["values"] = str(node.get("key"))
        return {name: _with_absolute_paths(each, folder, keys[name]) for name, each in node.items()}
    if isinstance(node, list | tuple):
        below = key if names_file(key) else f"{key}.*"
        return [_with_absolute_paths(each, folder, below) for each in node]
    is_path = names_file(key) and isinstance(node, str) and (Path(node).suffix or Path(node).name != node)
    return str((folder / node).absolute()) if is_path else node
