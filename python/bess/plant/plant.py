"""One plant, the simulated system of the closed loop, and independent scenarios of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import _core
from bess.arrays import Array, Flags, check_times, number_array
from bess.display import as_table, few, one_line
from bess.errors import BessError, InputError
from bess.plant.flows import Flows, PlantSnapshot
from bess.system import State, System
from bess.system.state import TEMPERATURE_RANGE_C
from bess.system.system import check_system
from bess.units import SECONDS_PER_HOUR

_HEALTH = (3, 4, 2)
"""Columns of ``PlantSnapshot.ageing``: factors of capacity and resistance, and loss by cycle ageing."""

_WITHOUT_STRINGS = ("auxiliary_kw", "coolant_c")
"""Flows without a string axis."""


class CoreController(Protocol):
    """A controller that the core runs over many steps."""

    def run(
        self,
        plant: _core.Plant,
        ahead_kw: Array,
        limit_kw: Array,
        ambient_c: Array,
        step_s: float,
    ) -> dict[str, NDArray[Any]]:
        """Advance the plant; return its record and ``request_kw``, as flat arrays."""


@contextmanager
def _input_errors() -> Iterator[None]:
    """Convert errors of the core to errors of the package."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"plant: {error}") from error
    except RuntimeError as error:  # the core is borrowed
        raise BessError("plant: another thread is advancing it; give each thread its own plant") from error


def _numbers(name: str, values: ArrayLike, shape: tuple[int | str, ...], unit: str) -> Array:
    """Return ``values`` as float64 of the given shape; a text in the shape stands for any length."""
    array = number_array(f"plant: {name} [{unit}]", values)
    fits = array.ndim == len(shape) and all(
        isinstance(want, str) or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = f", needs {shape}".replace("'", "") if shape else "; give one number"
        raise InputError(f"plant: {name} [{unit}] has shape {array.shape}{wanted}")
    return array


def _number(name: str, value: ArrayLike, unit: str) -> float:
    return float(_numbers(name, value, (), unit))


def _truth_values(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Flags:
    try:
        flags = np.asarray(values)
    except ValueError as error:  # lists of unequal length
        raise InputError(f"plant: {name} must be an array of truth values ({error})") from error
    if flags.dtype != np.bool_ or flags.shape != shape:
        raise InputError(
            f"plant: {name} must be truth values of shape {shape}, not {flags.dtype} of shape {flags.shape}"
        )
    return flags


class _Simulation:
    """Common base of plant and ensemble; in an ensemble, the first axis of all arrays is the scenario."""

    def __init__(
        self,
        system: System,
        states: Sequence[State],
        lead: tuple[int, ...],
        plant_step_s: float | None,
        derating_law: str,
        ambient_c: float | None,
    ) -> None:
        check_system(system)
        for state in states:
            system.check_state(state)
        if not isinstance(derating_law, str):
            raise InputError(f"plant: derating_law must be a name, not {type(derating_law).__name__}")
        self.system = system
        self._lead, self._shape, self._scenarios = lead, (*lead, system.n_strings), len(states)
        ambient_c = system.ambient_c if ambient_c is None else ambient_c
        self._ambient_c = _number("ambient_c", ambient_c, "degC")
        low_c, high_c = TEMPERATURE_RANGE_C
        if not low_c <= self._ambient_c <= high_c:
            raise InputError(
                f"plant: ambient_c {self._ambient_c:g} degC is outside [{low_c:g}, {high_c:g}] degC"
            )
        self._nodes = np.array([string.thermal.spatial.nodes for string in system.strings])
        nodes = int(self._nodes.max())
        # Strings with fewer nodes than others are padded with NaN.
        self._is_node = np.arange(nodes) < self._nodes[:, None]
        temperature_c = np.array([state.temperature_c for state in states])
        start = {
            "soc": np.array([state.soc for state in states]).ravel(),
            "node_temperature_c": np.repeat(temperature_c.ravel(), nodes),
            "derating_integral_k": np.zeros(temperature_c.size),
            "inverter_on": np.zeros(temperature_c.size, dtype=np.bool_),
            "soh_capacity": np.array([state.soh_capacity for state in states]).ravel(),
            "soh_resistance": np.array([state.soh_resistance for state in states]).ravel(),
        }
        self._derating_law = derating_law
        plant_step_s = system.control.plant_step_s if plant_step_s is None else plant_step_s
        self._plant_step_s = _number("plant_step_s", plant_step_s, "s")
        with _input_errors():
            self.core = _core.Plant(system.core, len(states), self._plant_step_s, derating_law, start)

    def __getstate__(self) -> tuple[tuple[Any, ...], PlantSnapshot]:
        """Parameters and state; the core is rebuilt."""
        settings = self.plant_step_s, self._derating_law, self._ambient_c
        return (self.system, self._states(), self._lead, *settings), self.snapshot()

    def __setstate__(self, state: tuple[tuple[Any, ...], PlantSnapshot]) -> None:
        parameters, snapshot = state
        _Simulation.__init__(self, *parameters)
        self.restore(snapshot)

    @property
    def plant_step_s(self) -> float:
        """Plant step [s]."""
        return self._plant_step_s

    def step(
        self,
        request_kw: ArrayLike,
        step_s: float = 900.0,
        *,
        ambient_c: ArrayLike | None = None,
        reactive_kvar: ArrayLike | None = None,
    ) -> Flows:
        """Advance by one control step: :meth:`run` without the axis of steps, node temperatures included."""
        request = _numbers("request_kw", request_kw, self._shape, "kW")
        reactive = self._reactive(reactive_kvar, request.shape)
        air_c = self._air_c(ambient_c, 1)
        return self._advance(request, reactive, air_c, _number("control step", step_s, "s"), nodes=True)

    def run(
        self,
        request_kw: ArrayLike,
        step_s: float = 900.0,
        *,
        ambient_c: ArrayLike | None = None,
        nodes: bool = False,
        reactive_kvar: ArrayLike | None = None,
    ) -> Flows:
        """Advance through a horizon in one call, with the same results as repeated :meth:`step` calls.

        Parameters
        ----------
        request_kw
            Set-points [kW], positive = discharge: shape ``(n_steps, n_strings)`` for a plant, and
            ``(n_scenarios, n_steps, n_strings)`` for an ensemble.
        step_s
            Length of a control step [s], a multiple of the plant step, a day at most.
        ambient_c
            Air inlet temperature [degC]: one value, one per step, or for an ensemble ``(n_scenarios,
            n_steps)``; the plant's own if None.
        nodes
            Keep the node temperatures of every step.
        reactive_kvar
            Reactive power [kvar] in the shape of ``request_kw``, positive = supplied.

        Returns
        -------
        Flows
            Arrays in the shape of ``request_kw``.
        """
        request = _numbers("request_kw", request_kw, (*self._lead, "n_steps", self._shape[-1]), "kW")
        reactive = self._reactive(reactive_kvar, request.shape)
        air_c = self._air_c(ambient_c, request.shape[-2])
        step_s = _number("control step", step_s, "s")
        dt_h = step_s / SECONDS_PER_HOUR
        check_times("plant: request_kw", request_kw, dt_h, axis=-2)
        check_times("plant: reactive_kvar", reactive_kvar, dt_h, axis=-2)
        check_times("plant: ambient_c", ambient_c, dt_h)
        if not self._lead:
            return self._advance(request, reactive, air_c, step_s, nodes=nodes)
        # The core has the step first, then the scenario.
        reactive = None if reactive is None else reactive.swapaxes(0, 1)
        flows = self._advance(request.swapaxes(0, 1), reactive, air_c, step_s, nodes=nodes)
        return flows.map(lambda values: values.swapaxes(0, 1))

    def snapshot(self) -> PlantSnapshot:
        """Return the complete state, for :meth:`restore`."""
        several, shapes = (*self._shape, -1), {"coolant": (*self._lead, -1)}
        shapes |= {"node_temperature_c": several, "ageing": several}
        flat = self._core_state()
        arrays = {name: values.reshape(shapes.get(name, self._shape)) for name, values in flat.items()}
        return PlantSnapshot(**arrays)

    def restore(self, snapshot: PlantSnapshot) -> None:
        """Restore a snapshot; the simulation continues from it to the last bit.

        Raises
        ------
        InputError
            The snapshot does not fit the plant, or a value is outside its range: -60 to 150 degC of a node.
        """
        if not isinstance(snapshot, PlantSnapshot):
            raise InputError(f"plant: snapshot must be a PlantSnapshot, not {type(snapshot).__name__}")
        flat: dict[str, Any] = {}
        own = vars(self.snapshot())
        for name, values in vars(snapshot).items():
            if values is None and name in ("cooling_stages", "coolant"):
                continue
            array: NDArray[Any] = (
                _truth_values(f"snapshot: {name}", values, self._shape)
                if name == "inverter_on"
                else number_array(f"plant: snapshot: {name}", values)
            )
            # The core checks the number of values; rows of ``ageing`` may be longer than those of this plant.
            if own[name] is not None and array.shape[:-1] != own[name].shape[:-1]:
                raise InputError(f"plant: snapshot: {name} has shape {array.shape}, needs {own[name].shape}")
            flat[name] = array.ravel()
        with _input_errors():
            self.core.set_state(flat)

    def _core_state(self) -> dict[str, NDArray[Any]]:
        with _input_errors():
            return self.core.state()

    def _states(self) -> list[State]:
        """Measured state of each scenario."""
        flat, shape = self._core_state(), (self._scenarios, self._shape[-1])
        node_c = flat["node_temperature_c"].reshape(*shape, -1)
        mean_c = node_c.sum(axis=2, where=self._is_node) / self._nodes
        rows = flat["ageing"].reshape(*shape, -1)
        health = (rows[..., place] for place in _HEALTH)
        return [State(*each) for each in zip(flat["soc"].reshape(shape), mean_c, *health, strict=True)]

    def _reactive(self, reactive_kvar: ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
        return None if reactive_kvar is None else _numbers("reactive_kvar", reactive_kvar, shape, "kvar")

    def _air_c(self, ambient_c: ArrayLike | None, n_steps: int) -> Array:
        """Air inlet temperature [degC], shape ``(n_steps, n_scenarios)``."""
        given = number_array("plant: ambient_c [degC]", self._ambient_c if ambient_c is None else ambient_c)
        shape = ((), (n_steps,), (self._scenarios, n_steps))[min(given.ndim, 2)]
        air_c = np.empty((self._scenarios, n_steps))
        air_c[:] = _numbers("ambient_c", given, shape, "degC")
        return air_c.T

    def _advance(
        self,
        request_kw: Array,
        reactive_kvar: Array | None,
        air_c: Array,
        step_s: float,
        *,
        nodes: bool,
    ) -> Flows:
        """Call the core with requests, reactive power and air in its order: step, scenario, string."""
        reactive = None if reactive_kvar is None else reactive_kvar.ravel()
        with _input_errors():
            array = self.core.run(request_kw.ravel(), air_c.ravel(), step_s, nodes, reactive)
        return self._flows(array, request_kw.shape, nodes=nodes, reactive=reactive is not None)

    def _flows(
        self,
        array: dict[str, NDArray[Any]],
        shape: tuple[int, ...],
        *,
        nodes: bool = False,
        reactive: bool = False,
    ) -> Flows:
        """Convert the flat arrays of the core to flows of ``shape``."""
        cooled = self.system.cooling is not None
        included = {"cooling_kw": cooled, "coolant_c": cooled, "reactive_kvar": reactive}
        array = {name: values for name, values in array.items() if included.get(name, True)}
        node_c = array.pop("node_temperature_c")
        shared = {name: array.pop(name).reshape(shape[:-1]) for name in _WITHOUT_STRINGS if name in array}
        if len(shape) > 1:
            array = {name: values.reshape(shape) for name, values in array.items()}
        array["inverter_starts"] = array["inverter_starts"].astype(np.int64)
        array["ledger_residual_kwh"] = array["ledger_residual_kwh"].sum(axis=-1)
        return Flows(
            **array,
            **shared,
            node_temperature_c=node_c.reshape(*shape, self._nodes.max()) if nodes else None,
        )


class Plant(_Simulation):
    r"""Electro-thermal plant of a battery of parallel strings, each behind its own inverter.

    Rint cells, derating and the one-dimensional thermal model (forward in time, central in space) follow
    [1]_; cycles of ageing strings are counted as in [2]_.

    In every plant step (10 s), each string is derated by its temperature and limited by its SOC window and
    voltage. The step then computes inverter loss, Rint current, heat, SOC, and node temperatures of a
    one-dimensional thermal model along the air path, with a resistance for each node temperature. Undelivered
    power is reported as derating loss or availability loss. Self-discharge, voltage dynamics and the start-up
    time of inverters are not modelled.

    A system with a section ``[cooling]`` has thermostats, fans or pumps, and a chiller; they draw
    :attr:`Flows.auxiliary_kw` from the grid. Without this section, ambient air cools the strings at constant
    flow without auxiliary power.

    Reactive power loads the inverters: their losses follow the apparent power :math:`\sqrt{P^2 + Q^2}`, and
    active power has priority within nominal power (equations R1 and R2 of docs/equations.md). The battery
    covers these losses. An inverter without active power draws them from the grid, as part of
    :attr:`Flows.standby_kw`, so empty and full strings can also supply reactive power.

    Strings whose section ``[wear]`` names a cell model age: at control steps at least 900 s apart, their
    capacity decreases and their resistance increases at constant SOC. The charge lost with the capacity is
    :attr:`Flows.aged_charge_ah`, so ``capacity * soc`` changes only by the current and by this charge.

    Parameters
    ----------
    system
        The plant.
    state
        Initial state; all nodes of a string start at its mean temperature. ``wear.calendar_share`` divides an
        initial capacity loss (1 - state of health) into calendar and cycle ageing.
    plant_step_s
        Inner step [s]; by default the step of the system (10 s).
    derating_law
        "table": factor over mean temperature; "pi": the PI law with the system's gains.
    ambient_c
        Air inlet temperature of steps without a value [degC]; by default that of the system.

    Raises
    ------
    InputError
        The state does not fit the system, the ambient temperature is outside -60 to 150 degC, or the plant
        step is unstable (the message gives the maximum).

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    .. [2] ASTM E1049-85: Standard practices for cycle counting in fatigue analysis.

    Examples
    --------
    >>> import bess
    >>> system = bess.System.reference(n_strings=2)
    >>> plant = bess.Plant(system, bess.State(soc=[0.5, 0.5], temperature_c=[25.0, 25.0]))
    >>> flows = plant.step([46.0, 0.0])
    >>> flows.delivered_kw.round(6).tolist()
    [46.0, 0.0]
    """

    def __init__(
        self,
        system: System,
        state: State,
        *,
        plant_step_s: float | None = None,
        derating_law: Literal["table", "pi"] = "table",
        ambient_c: float | None = None,
    ) -> None:
        super().__init__(system, [state], (), plant_step_s, derating_law, ambient_c)

    def _facts(self) -> dict[str, str]:
        state = self.state
        return {
            "system": self.system.name,
            "strings": str(self.system.n_strings),
            "soc": few(state.soc),
            "temperature": few(state.temperature_c, "°C"),
            "step": f"{self.plant_step_s:g} s",
        }

    __repr__ = one_line
    _repr_html_ = as_table

    @property
    def state(self) -> State:
        """Measured state: SOC, mean temperature and state of health of each string."""
        return self._states()[0]

    def run_controller(
        self,
        controller: CoreController,
        ahead_kw: Array,
        limit_kw: Array,
        ambient_c: Array,
        step_s: float,
    ) -> tuple[Array, Flows]:
        """Advance in closed loop with a controller of the core, in one call.

        Parameters
        ----------
        controller
            Controller distilled for this plant, or a rule.
        ahead_kw : ndarray, shape (n_steps, horizon_steps)
            Demand [kW] of each step, at most the sum of ``limit_kw``, and forecast of the next steps.
        limit_kw : ndarray, shape (n_steps, n_strings)
            Maximum power of each inverter [kW].
        ambient_c : ndarray, shape (n_steps,)
            Air inlet temperature [degC].
        step_s
            Length of a control step [s].

        Returns
        -------
        request_kw : ndarray, shape (n_steps, n_strings)
            Set-points [kW].
        flows : Flows
            As for :meth:`run`.

        Raises
        ------
        InputError
            The shapes do not fit each other, or as for :meth:`run`.
        """
        shape = limit_kw.shape
        inputs = np.ascontiguousarray(ahead_kw), np.ascontiguousarray(limit_kw), ambient_c, step_s
        with _input_errors():
            array = controller.run(self.core, *inputs)
        request_kw = array.pop("request_kw").reshape(shape)
        return request_kw, self._flows(array, shape)

    def renew(self, strings: ArrayLike) -> None:
        """Replace the batteries of some strings by new ones, at their SOC and temperature.

        Parameters
        ----------
        strings : array_like of bool, shape (n_strings,)
            The strings whose state of health becomes 1 and whose past cycles are forgotten.

        Raises
        ------
        InputError
            ``strings`` has another shape, or holds anything but truth values.
        """
        chosen = _truth_values("strings", strings, self._shape)
        state, old = self.state, self.snapshot()
        new = Plant(self.system, State(state.soc, state.temperature_c)).snapshot().ageing
        rows = np.zeros((new.shape[0], max(new.shape[1], old.ageing.shape[1])))
        for each, taken in ((old.ageing, ~chosen), (new, chosen)):
            rows[taken, : each.shape[1]] = each[taken]
        self.restore(replace(old, ageing=rows))


class PlantEnsemble(_Simulation):
    """Independent scenarios of one plant, simulated in parallel in one call.

    The scenarios differ in state, requests and ambient temperature and do not interact. Model, parameters and
    methods are those of :class:`~bess.Plant`; all arrays have the scenario as first axis.

    Parameters
    ----------
    system
        The plant.
    states
        One state for each scenario.
    plant_step_s, derating_law, ambient_c
        As for :class:`~bess.Plant`.

    Attributes
    ----------
    core : bess._core.Plant
        The plant in the core; advancing it advances the ensemble.

    Raises
    ------
    InputError
        A state does not fit the system, or the plant step is unstable (the message gives the maximum).
    """

    def __init__(
        self,
        system: System,
        states: Sequence[State],
        *,
        plant_step_s: float | None = None,
        derating_law: Literal["table", "pi"] = "table",
        ambient_c: float | None = None,
    ) -> None:
        if not isinstance(states, Sequence) or not states:
            raise InputError("plant: needs a list of at least one state")
        super().__init__(system, states, (len(states),), plant_step_s, derating_law, ambient_c)

    @property
    def states(self) -> list[State]:
        """Measured state of each scenario."""
        return self._states()
