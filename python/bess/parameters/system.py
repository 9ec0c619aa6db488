"""A plant: its strings, validated once, and its tables in the Rust core."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from bess import _core
from bess.errors import InputError
from bess.parameters.documents import deep_merge, describe
from bess.parameters.sections import Battery, Control, Derating, Inverter, Section, Site, Thermal
from bess.parameters.state import State

_OVERRIDABLE = ("system", "battery", "inverter", "derating", "thermal")


class StringParameters(Section):
    """All sections of one string."""

    site: Site
    battery: Battery
    inverter: Inverter
    derating: Derating
    thermal: Thermal


class System:
    """A plant of parallel strings, each with its own inverter.

    Immutable. Build one with :meth:`reference` or :func:`bess.load_system`.

    Attributes
    ----------
    name : str
        Where the description came from.
    strings : tuple of StringParameters
        One entry for each string.
    control : Control
        Control step [min], horizon [steps], plant step [s].
    ambient_c : float
        Ambient temperature [degC] unless a weather file gives it.
    core : bess._core.System
        The string-level tables, shared by plant and control model.
    """

    def __init__(self, document: Mapping[str, Any], *, name: str = "system") -> None:
        self.name = name
        self.document: dict[str, Any] = json.loads(json.dumps(document))
        strings, self.control = _parse(self.document, name)
        self.strings: tuple[StringParameters, ...] = strings
        self.ambient_c: float = strings[0].site.ambient_c
        try:
            self.core = _core.System(
                json.dumps({"strings": [s.model_dump(exclude={"site"}) for s in strings]})
            )
        except ValueError as error:
            raise InputError(f"{name}: {error}") from error

    @classmethod
    def reference(cls, n_strings: int = 2) -> Self:
        """Return the reference system (two NMC strings of 92 kW / 266 kWh), with any number of equal strings."""
        document = tomllib.loads(resources.files("bess.data.systems").joinpath("reference.toml").read_text())
        document["system"]["n_strings"] = n_strings
        return cls(document, name="reference")

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return len(self.strings)

    @cached_property
    def nominal_kw(self) -> NDArray[np.float64]:
        """Nominal AC power of each inverter [kW], shape ``(n_strings,)``."""
        return np.array([s.inverter.nominal_kw for s in self.strings])

    @cached_property
    def capacity_ah(self) -> NDArray[np.float64]:
        """Charge capacity of each string [Ah], shape ``(n_strings,)``."""
        return np.array([s.battery.cell_capacity_ah * s.battery.cells_parallel for s in self.strings])

    @cached_property
    def nominal_energy_kwh(self) -> NDArray[np.float64]:
        """Capacity times the mean discharge OCV at 25 degC [kWh], shape ``(n_strings,)``."""
        energies = []
        for string in self.strings:
            ocv = string.battery.ocv_v
            row = int(np.argmin(np.abs(np.array(ocv.temperature_c) - 25.0)))
            soc = np.array(ocv.soc)
            mean_v = np.trapezoid(np.array(ocv.discharge[row]), soc) / (soc[-1] - soc[0])
            energies.append(mean_v * string.battery.cells_series)
        return np.array(energies) * self.capacity_ah / 1000.0

    def initial_state(self) -> State:
        """State in which the file starts every string."""
        return State(
            soc=[s.site.initial_soc for s in self.strings],
            temperature_c=[s.site.initial_temperature_c for s in self.strings],
        )

    def check_state(self, state: State) -> None:
        """Raise :class:`InputError` unless ``state`` fits this system (number of strings, SOC windows)."""
        if state.n_strings != self.n_strings:
            raise InputError(
                f"state has {state.n_strings} strings, system {self.name!r} has {self.n_strings}"
            )
        for index, (string, soc) in enumerate(zip(self.strings, state.soc, strict=True)):
            low, high = string.battery.soc_min, string.battery.soc_max
            if not low - 1e-9 <= soc <= high + 1e-9:
                raise InputError(f"string {index}: soc {soc:g} is outside its window [{low:g}, {high:g}]")

    def __repr__(self) -> str:
        return (
            f"System({self.name!r}, n_strings={self.n_strings}, "
            f"{self.nominal_kw.sum():g} kW, {self.nominal_energy_kwh.sum():.0f} kWh)"
        )


def load_system(path: str | Path) -> System:
    """Read a system file (TOML, format of ``bess list`` systems) and check all of it.

    Parameters
    ----------
    path
        File to read. ``[[string]]`` tables override any section for one string, in the order of the strings.

    Raises
    ------
    InputError
        With the file, the key, its value and what is allowed; all problems at once.
    """
    path = Path(path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such system file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML ({error})") from error
    return System(document, name=str(path))


def _parse(document: Mapping[str, Any], name: str) -> tuple[tuple[StringParameters, ...], Control]:
    known = {*_OVERRIDABLE, "control", "string"}
    if unknown := sorted(set(document) - known):
        raise InputError(f"{name}: unknown section {unknown[0]!r}; allowed: {', '.join(sorted(known))}")
    overrides = document.get("string", [])
    if not isinstance(overrides, list) or not all(isinstance(entry, dict) for entry in overrides):
        raise InputError(f"{name}: string: write one [[string]] table for each string")
    site = document.get("system", {})
    if not isinstance(site, dict):
        raise InputError(f"{name}: system: must be a table")
    try:
        control = Control.model_validate(document.get("control", {}))
        n_strings = Site.model_validate({"n_strings": len(overrides) or 1, **site}).n_strings
    except ValidationError as error:
        raise InputError(describe(error, name, prefix=_section_of(error))) from error
    if len(overrides) > n_strings:
        raise InputError(f"{name}: {len(overrides)} [[string]] tables for system.n_strings = {n_strings}")

    base = {key: document.get(key, {}) for key in _OVERRIDABLE}
    base["system"] = {**site, "n_strings": n_strings}
    plain = _string(base, name) if len(overrides) < n_strings else None
    strings = []
    for index in range(n_strings):
        if index >= len(overrides):
            assert plain is not None
            strings.append(plain)
            continue
        override = overrides[index]
        if unknown := sorted(set(override) - set(_OVERRIDABLE)):
            raise InputError(
                f"{name}: string[{index}].{unknown[0]}: unknown section; allowed: {', '.join(_OVERRIDABLE)}"
            )
        if "n_strings" in override.get("system", {}):
            raise InputError(f"{name}: string[{index}].system.n_strings: belongs to [system]")
        strings.append(_string(deep_merge(base, override), name, place=f"string[{index}]."))
    return tuple(strings), control


def _string(sections: Mapping[str, Any], name: str, place: str = "") -> StringParameters:
    renamed = {"site" if key == "system" else key: value for key, value in sections.items()}
    try:
        return StringParameters.model_validate(renamed)
    except ValidationError as error:
        raise InputError(describe(error, name, prefix=place, rename={"site": "system"})) from error


def _section_of(error: ValidationError) -> str:
    return "control." if error.title == "Control" else "system."
