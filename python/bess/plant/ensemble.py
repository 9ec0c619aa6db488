"""Independent scenarios of one plant, simulated in parallel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import _core
from bess.errors import InputError
from bess.plant.flows import Flows
from bess.plant.inputs import ambient, any_shape, numbers, one_number, refusals
from bess.plant.snapshot import PlantSnapshot
from bess.system import State, System

_CONTROL_STEP_S = 900.0

_HEALTH = (4, 5, 3)
"""Columns of ``PlantSnapshot.ageing``: factors of capacity and resistance, and loss by cycle ageing."""

_REMEMBERED = {"soc": "1", "node_temperature_c": "degC", "derating_integral_k": "K", "ageing": "1"}
"""Numbers of a snapshot, with their units."""

_COOLING = {"cooling_stages": "1", "coolant": "1"}
"""Further numbers of a snapshot, for plants with cooling only."""

_OF_THE_PLANT = ("auxiliary_kw", "coolant_c")
"""Flows without a string axis."""


class PlantEnsemble:
    """Independent scenarios of one plant, simulated in one call.

    The model of each plant is that of :class:`Plant` [1]_.

    The scenarios differ in state, requests and ambient temperature and do not interact. Parameters and
    behaviour are those of :class:`~bess.Plant`, with the scenario as an additional leading axis of all
    arrays.

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

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
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
        if not isinstance(system, System):
            raise InputError(f"plant: system must be a bess.System, not {type(system).__name__}")
        if not isinstance(states, Sequence) or not states:
            raise InputError("plant: needs a list of at least one state")
        for state in states:
            system.check_state(state)
        if not isinstance(derating_law, str):
            raise InputError(f"plant: derating_law must be a name, not {type(derating_law).__name__}")
        self.system = system
        self.n_scenarios = len(states)
        self.ambient_c = system.ambient_c if ambient_c is None else one_number("ambient_c", ambient_c, "degC")
        self._nodes = np.array([string.thermal.spatial.nodes for string in system.strings])
        nodes = int(self._nodes.max())
        # Strings with fewer nodes than others are padded with NaN.
        self._real = np.arange(nodes) < self._nodes[:, None]
        self._shape = (self.n_scenarios, system.n_strings)
        self._cooled = system.cooling is not None
        temperature_c = np.array([state.temperature_c for state in states])
        start = {
            "soc": np.array([state.soc for state in states]).ravel(),
            "node_temperature_c": np.repeat(temperature_c[..., None], nodes, axis=2).ravel(),
            "derating_integral_k": np.zeros(temperature_c.size),
            "inverter_on": np.zeros(temperature_c.size, dtype=np.bool_),
            "soh_capacity": np.array([state.soh_capacity for state in states]).ravel(),
            "soh_resistance": np.array([state.soh_resistance for state in states]).ravel(),
        }
        self._derating_law = derating_law
        step_s = system.control.plant_step_s
        if plant_step_s is not None:
            step_s = one_number("plant_step_s", plant_step_s, "s")
        with refusals():
            self.core = _core.Plant(system.core, self.n_scenarios, step_s, derating_law, start)

    def __getstate__(self) -> dict[str, Any]:
        """Parameters and state of the ensemble; the core is rebuilt."""
        settings = {
            "plant_step_s": self.plant_step_s,
            "derating_law": self._derating_law,
            "ambient_c": self.ambient_c,
        }
        return {
            "system": self.system,
            "states": self.states,
            "settings": settings,
            "snapshot": self.snapshot(),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["system"], state["states"], **state["settings"])  # type: ignore[misc]
        self.restore(state["snapshot"])

    @property
    def plant_step_s(self) -> float:
        """Plant step [s]."""
        return self.core.plant_step_s

    @property
    def states(self) -> list[State]:
        """Measured state of each scenario."""
        flat = self.core.state()
        node_c = flat["node_temperature_c"].reshape(*self._shape, -1)
        mean_c = node_c.sum(axis=2, where=self._real) / self._nodes
        soc = flat["soc"].reshape(self._shape)
        rows = flat["ageing"].reshape(*self._shape, -1)
        health = (rows[..., place] for place in _HEALTH)
        return [State(*each) for each in zip(soc, mean_c, *health, strict=True)]

    def step(
        self,
        request_kw: ArrayLike,
        step_s: float = _CONTROL_STEP_S,
        *,
        ambient_c: ArrayLike | None = None,
    ) -> Flows:
        """Advance every scenario by one control step.

        Parameters
        ----------
        request_kw
            Set-points [kW], shape ``(n_scenarios, n_strings)``, positive = discharge.
        step_s
            Length of the control step [s], a multiple of the plant step, a day at most.
        ambient_c
            Air inlet temperature [degC], one for all or shape ``(n_scenarios, 1)``; the plant's own if None.

        Returns
        -------
        Flows
            Arrays of shape ``(n_scenarios, n_strings)``, node temperatures included.
        """
        request = numbers("request_kw", request_kw, self._shape, "kW")
        air_c = ambient(ambient_c, self.ambient_c, self.n_scenarios, 1)
        return self.advance(request, air_c, step_s, self._shape, nodes=True)

    def run(
        self,
        request_kw: ArrayLike,
        step_s: float = _CONTROL_STEP_S,
        *,
        ambient_c: ArrayLike | None = None,
        nodes: bool = False,
    ) -> Flows:
        """Advance every scenario through a horizon, in one call of the core.

        Parameters
        ----------
        request_kw
            Set-points [kW], shape ``(n_scenarios, n_steps, n_strings)``, positive = discharge.
        step_s
            Length of a control step [s], a multiple of the plant step, a day at most.
        ambient_c
            Air inlet temperature [degC]: one value, one per step, or shape ``(n_scenarios, n_steps)``.
        nodes
            Keep the node temperatures of every step.

        Returns
        -------
        Flows
            Arrays of shape ``(n_scenarios, n_steps, n_strings)``.

        Raises
        ------
        InputError
            Wrong shape, NaN, a request above nominal power, a step that is not a multiple of the plant step,
            or more than 1e10 plant steps x strings. The state is then unchanged.
        """
        scenarios, strings = self._shape
        request = numbers("request_kw", request_kw, (scenarios, "n_steps", strings), "kW")
        steps = request.shape[1]
        air_c = ambient(ambient_c, self.ambient_c, scenarios, steps)
        flows = self.advance(request.swapaxes(0, 1), air_c, step_s, (steps, scenarios, strings), nodes=nodes)
        return flows.map(lambda values: values.swapaxes(0, 1))

    def advance(
        self,
        request_kw: NDArray[np.float64],
        air_c: NDArray[np.float64],
        step_s: float,
        shape: tuple[int, ...],
        *,
        nodes: bool,
        reactive_kvar: NDArray[np.float64] | None = None,
    ) -> Flows:
        """Call the core with requests in the order (step, scenario, string); return flows of ``shape``.

        The last axis of ``shape`` is the string; leading axes of length 1 may be omitted. ``air_c`` has the
        order (step, scenario), ``reactive_kvar`` the order of requests.
        """
        step_s = one_number("control step", step_s, "s")
        with refusals():
            asked_kvar = None if reactive_kvar is None else reactive_kvar.ravel()
            array = self.core.run(request_kw.ravel(), air_c.ravel(), step_s, nodes, asked_kvar)
        return self.flows(array, shape, nodes=nodes)

    def flows(self, array: dict[str, NDArray[Any]], shape: tuple[int, ...], *, nodes: bool = False) -> Flows:
        """Convert the flat arrays of the core to flows of ``shape``."""
        node_c = array.pop("node_temperature_c")
        shared = {name: array.pop(name).reshape(shape[:-1]) for name in _OF_THE_PLANT if name in array}
        if len(shape) > 1:
            array = {name: values.reshape(shape) for name, values in array.items()}
        array["inverter_starts"] = array["inverter_starts"].astype(np.int64)
        array["ledger_residual_kwh"] = array["ledger_residual_kwh"].sum(axis=-1)
        return Flows(
            **array,
            **shared,
            node_temperature_c=node_c.reshape(*shape, self.core.max_nodes) if nodes else None,
        )

    def snapshot(self) -> PlantSnapshot:
        """Return the complete state of the ensemble, for :meth:`restore`."""
        flat = self.core.state()
        return PlantSnapshot(
            soc=flat["soc"].reshape(self._shape),
            node_temperature_c=flat["node_temperature_c"].reshape(*self._shape, -1),
            derating_integral_k=flat["derating_integral_k"].reshape(self._shape),
            inverter_on=flat["inverter_on"].reshape(self._shape),
            ageing=flat["ageing"].reshape(*self._shape, -1),
            cooling_stages=flat["cooling_stages"].reshape(self._shape) if self._cooled else None,
            coolant=flat["coolant"].reshape(self.n_scenarios, -1) if self._cooled else None,
        )

    def restore(self, snapshot: PlantSnapshot) -> None:
        """Restore a snapshot; the ensemble continues from it to the last bit.

        Raises
        ------
        InputError
            Not a snapshot, or not a snapshot of such an ensemble.
        """
        if not isinstance(snapshot, PlantSnapshot):
            raise InputError(f"plant: snapshot must be a PlantSnapshot, not {type(snapshot).__name__}")
        with refusals():
            self.core.set_state(_flat(snapshot))


def _flat(snapshot: PlantSnapshot) -> dict[str, NDArray[np.float64] | NDArray[np.bool_]]:
    values: dict[str, NDArray[np.float64] | NDArray[np.bool_]] = {
        name: any_shape(f"snapshot: {name}", getattr(snapshot, name), unit).ravel()
        for name, unit in (_REMEMBERED | _COOLING).items()
        if name in _REMEMBERED or getattr(snapshot, name) is not None
    }
    return values | {"inverter_on": np.asarray(snapshot.inverter_on, dtype=np.bool_).ravel()}
