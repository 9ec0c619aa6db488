"""A plant: validated strings and their look-up tables in the Rust core."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from bess import _core
from bess.arrays import Array, each_step, read_only
from bess.display import as_table
from bess.errors import InputError, placed
from bess.files import MissingFileError
from bess.system.components.registry import SYSTEMS, system_document
from bess.system.documents import plain, read_toml
from bess.system.lumped import Lumped, identify
from bess.system.parse import StringParameters, parse_system
from bess.system.sections import LumpedThermal
from bess.system.state import TEMPERATURE_RANGE_C, State


class System:
    """A plant of parallel strings, each with its own inverter.

    Immutable, with read-only arrays. Build one with :meth:`reference` or :func:`bess.load_system`, or from a
    changed :attr:`document`.

    Attributes
    ----------
    name : str
        Source of the description.
    document : dict
        A copy of the description as given: tables of numbers, texts and lists.
        ``System(system.document)`` is an equal system.
    strings : tuple of StringParameters
        One entry for each string.
    control : Control
        Control step [min], horizon [steps], plant step [s].
    ambient_c : float
        Ambient temperature [degC] unless a weather file gives it.
    cooling : Cooling or None
        Section ``[cooling]``; None for ambient-air cooling without auxiliary power.
    lumped : Lumped or None
        With cooling, the lumped thermal model identified from the plant, which replaces
        ``[thermal.lumped]``.
    core : bess._core.System
        The string-level tables, shared by plant and control model.
    """

    def __init__(self, document: Mapping[str, Any], *, name: str = "system") -> None:
        self.name = name
        with placed(name):
            self._document: dict[str, Any] = plain(document)
            strings, plant = parse_system(self._document)
            self.control, self.cooling = plant.control, plant.cooling
            self.strings: tuple[StringParameters, ...] = strings
            self.ambient_c: float = strings[0].site.ambient_c
            self.core = self._tables()
            self.lumped = None if self.cooling is None else self._identified()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the objects of the core, which are rebuilt on loading."""
        return {name: value for name, value in vars(self).items() if name not in ("core", "_control")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        vars(self)["core"] = self._tables()

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse changes after construction: they would reach only some of the calls."""
        if "lumped" in vars(self):  # the last attribute that the constructor sets
            raise InputError(
                f"system: {name} cannot be set, a System is immutable; build one from its changed document, "
                "bess.System(document)"
            )
        super().__setattr__(name, value)

    @property
    def document(self) -> dict[str, Any]:
        """A copy of the description as given."""
        return copy.deepcopy(self._document)

    def __eq__(self, other: object) -> bool:
        """Whether strings, control and cooling are equal; names are not compared."""
        if not isinstance(other, System):
            return NotImplemented
        return (self.strings, self.control, self.cooling) == (other.strings, other.control, other.cooling)

    def __hash__(self) -> int:
        return hash((self.n_strings, self.ambient_c))

    def _identified(self) -> Lumped:
        """Identify the lumped thermal model of a cooled plant, and put it into the strings."""
        try:
            found = identify(self.core, self.strings, self.control)
        except ValueError as error:
            raise InputError(str(error)) from error
        cooled = []
        for string, k1, k2 in zip(self.strings, found.k1_k_per_j, found.k2_per_s, strict=True):
            lumped = LumpedThermal(k1_k_per_j=float(k1), k2_per_s=float(k2))
            thermal = string.thermal.model_copy(update={"lumped": lumped})
            cooled.append(string.model_copy(update={"thermal": thermal}))
        self.strings = tuple(cooled)
        self.core = self._tables()
        return found

    def _tables(self) -> _core.System:
        cooling = None if self.cooling is None else self.cooling.model_dump()
        document = {"strings": [string.core_document() for string in self.strings], "cooling": cooling}
        try:
            return _core.System(json.dumps(document))
        except ValueError as error:
            raise InputError(str(error)) from error

    @property
    def reference_temperature_c(self) -> float:
        """Reference temperature of the control model at the system's own ambient temperature [degC]."""
        return float(self.surroundings_c(np.array(self.ambient_c)))

    def surroundings_c(self, ambient_c: Array) -> Array:
        """Return the reference temperature of the control model at given ambient temperatures [degC].

        The ambient temperature without a section ``[cooling]``, otherwise as identified from the plant
        (:attr:`lumped`).
        """
        return ambient_c if self.lumped is None else self.lumped.surroundings_c(ambient_c)

    @classmethod
    def reference(cls, n_strings: int = 2) -> Self:
        """Return the reference system (NMC strings of 92 kW / 268 kWh), any number of equal ones.

        Sizes, resistance and derating are from [1]_ if published there, and the open-circuit voltage is from
        [2]_. The page on parameters gives the source of each number.

        References
        ----------
        .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split
           control for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
        .. [2] Collath et al.: J. Energy Storage 87 (2024) 111508, doi:10.1016/j.est.2024.111508.
        """
        document = system_document("reference")
        document["system"]["n_strings"] = n_strings
        return cls(document, name="reference")

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return len(self.strings)

    @cached_property
    def min_power_kw(self) -> Array:
        """Minimum AC power of each inverter that is on [kW], shape ``(n_strings,)``."""
        return read_only(np.array([s.inverter.min_power_kw for s in self.strings]))

    @cached_property
    def nominal_kw(self) -> Array:
        """Nominal AC power of each inverter [kW], shape ``(n_strings,)``."""
        return read_only(np.array([s.inverter.nominal_kw for s in self.strings]))

    @cached_property
    def soc_window(self) -> tuple[Array, Array]:
        """Lower and upper SOC limits, shape ``(n_strings,)`` each."""
        batteries = [string.battery for string in self.strings]
        low, high = [each.soc_min for each in batteries], [each.soc_max for each in batteries]
        return read_only(np.array(low)), read_only(np.array(high))

    @cached_property
    def capacity_ah(self) -> Array:
        """Charge capacity of each string [Ah], shape ``(n_strings,)``."""
        parallel = [s.battery.cell_capacity_ah * s.battery.cells_parallel for s in self.strings]
        return read_only(np.array(parallel))

    @cached_property
    def nominal_energy_kwh(self) -> Array:
        """Capacity times the mean discharge OCV at 25 degC [kWh], shape ``(n_strings,)``."""
        mean_v = [s.battery.ocv_v.mean_v * s.battery.cells_series for s in self.strings]
        return read_only(np.array(mean_v) * self.capacity_ah / 1000.0)

    @cached_property
    def kinds(self) -> tuple[int, ...]:
        """Kind of each string, as an integer; strings of one kind have equal parameters."""
        first: dict[str, int] = {}
        texts = (json.dumps(string.core_document(), sort_keys=True) for string in self.strings)
        return tuple(first.setdefault(text, len(first)) for text in texts)

    def initial_state(self) -> State:
        """Return the initial state of the system file."""
        return State(
            soc=[s.site.initial_soc for s in self.strings],
            temperature_c=[s.site.initial_temperature_c for s in self.strings],
            soh_capacity=[s.site.initial_soh_capacity for s in self.strings],
            soh_resistance=[s.site.initial_soh_resistance for s in self.strings],
        )

    def core_at(self, state: State) -> _core.System:
        """Return the look-up tables of the strings at their present capacity and resistance."""
        if state.is_fresh:
            return self.core
        return self.core.aged(state.soh_capacity, state.soh_resistance)

    @cached_property
    def _control(self) -> _core.ControlModel:
        return _core.ControlModel(self.core)

    def control_at(self, state: State) -> _core.ControlModel:
        """Return the control model at present capacity and resistance; built once for fresh strings."""
        return self._control if state.is_fresh else _core.ControlModel(self.core_at(state))

    def check_state(self, state: State) -> None:
        """Raise :class:`InputError` unless ``state`` fits this system (number of strings, SOC windows)."""
        if not isinstance(state, State):
            raise InputError(f"state must be a bess.State, not {type(state).__name__}")
        if state.n_strings != self.n_strings:
            raise InputError(
                f"state has {state.n_strings} strings, system {self.name!r} has {self.n_strings}"
            )
        for index, (string, soc) in enumerate(zip(self.strings, state.soc, strict=True)):
            low, high = string.battery.soc_min, string.battery.soc_max
            if not low - 1e-9 <= soc <= high + 1e-9:
                raise InputError(f"string {index}: soc {soc:g} is outside its window [{low:g}, {high:g}]")

    def to_toml(self) -> str:
        """Return a system file without references to bundled components, which reads back to equal strings.

        Shared sections are written once, all others in one ``[[string]]`` table for each string.
        """
        import tomli_w  # only this function needs it

        sections = [string.table() for string in self.strings]
        shared = {key: value for key, value in sections[0].items() if all(s[key] == value for s in sections)}
        site = {"n_strings": self.n_strings, "ambient_c": self.ambient_c}
        document = {
            **shared,
            "system": {**site, **shared.get("system", {})},
            "control": self.control.model_dump(),
        }
        if self.cooling is not None:
            document["cooling"] = self.cooling.model_dump(exclude_none=True)
        if len(shared) < len(sections[0]):
            document["string"] = [
                {key: value for key, value in s.items() if key not in shared} for s in sections
            ]
        return tomli_w.dumps(document)

    def _facts(self) -> dict[str, str]:
        chosen = self.strings[0]
        return {
            "name": self.name,
            "strings": str(self.n_strings),
            "nominal power": f"{self.nominal_kw.sum():g} kW",
            "nominal energy": f"{self.nominal_energy_kwh.sum():.0f} kWh",
            "state of charge": f"{chosen.battery.soc_min:g} to {chosen.battery.soc_max:g}",
            "derating": f"{chosen.derating.start_c:g} to {chosen.derating.stop_c:g} °C",
            "control": f"{self.control.step_min:g} min, {self.control.horizon_steps} steps ahead",
        }

    _repr_html_ = as_table

    def __repr__(self) -> str:
        return (
            f"System({self.name!r}, n_strings={self.n_strings}, "
            f"{self.nominal_kw.sum():g} kW, {self.nominal_energy_kwh.sum():.0f} kWh)"
        )


def check_system(system: object) -> None:
    """Raise :class:`InputError` unless the argument is a system."""
    if not isinstance(system, System):
        raise InputError(f"system must be a bess.System, not {type(system).__name__}; see bess.load_system")


def surroundings_of_steps(system: System, ambient_c: ArrayLike | None, n_steps: int, dt_h: float) -> Array:
    """Return the temperature that strings cool towards in each step [degC]: as given, or the system's own."""
    around = system.reference_temperature_c if ambient_c is None else ambient_c
    return each_step("ambient_c", around, n_steps, dt_h, TEMPERATURE_RANGE_C, "degC")


def load_system(path: str | Path) -> System:
    """Read and validate a system file (TOML).

    Parameters
    ----------
    path
        File to read, or the name of a bundled system (``bess list``). ``[[string]]`` tables override any
        section for one string, in the order of the strings. ``battery.cell`` and ``inverter.model`` name
        bundled components; further keys override single values.

    Raises
    ------
    InputError
        The message gives file, key, value and allowed values.
    """
    if str(path) in SYSTEMS:
        return System(system_document(str(path)), name=str(path))
    if not isinstance(path, str | Path):
        raise InputError(f"a system is a bundled name or a path, not {type(path).__name__}")
    try:
        document = read_toml(Path(path))
    except MissingFileError:
        raise InputError(f"{path}: no such system file; bundled systems are {', '.join(SYSTEMS)}") from None
    return System(document, name=str(path))
