"""One plant: the truth that a controller is run against."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.display import as_table, few, one_line
from bess.explicit import ExplicitController
from bess.parameters import State, System
from bess.plant.fleet import Fleet
from bess.plant.flows import Flows
from bess.plant.inputs import ambient, numbers, refusals
from bess.plant.snapshot import PlantSnapshot


class Plant:
    r"""Electro-thermal plant of a battery of parallel strings, each behind its own inverter.

    Rint cells, derating and the one-dimensional thermal model (forward in time, central in space) follow
    [1]_; cycles of strings that age are counted as in [2]_.

    Every plant step (10 s) each string is derated by its temperature, limited by its SOC window and its
    voltage, and advanced: inverter loss at delivered power, Rint current, heat, a one-dimensional
    thermal model along the air path with the resistance of every node at its own temperature, SOC by
    charge. What is requested and not delivered is reported as derating loss or availability loss. Not
    modelled: self-discharge, voltage dynamics, start-up time of inverters.

    A system with a section ``[cooling]`` has thermostats, fans or pumps, and a source of cold, which take
    :attr:`Flows.auxiliary_kw` from the grid; without one, air of the ambient passes the strings at a constant
    flow and costs nothing.

    Reactive power, where it is asked for, loads the inverters: their losses are those of the apparent power
    :math:`\sqrt{P^2 + Q^2}`, and what active power leaves of nominal power is the most they carry (equations
    R1 and R2 of docs/equations.md). The battery covers the losses as ever; an inverter that delivers no
    active power draws them from the grid, as part of :attr:`Flows.standby_kw`, so that empty and full strings
    carry reactive power as well.

    Strings whose section ``[wear]`` names a cell model age: after a control step, once at least 900 s have
    gathered, their capacity falls and their resistance rises. SOC stays what it is then; the charge that goes
    with the capacity is :attr:`Flows.aged_charge_ah`, so that ``capacity * soc`` changes by the current and
    by that alone.

    Parameters
    ----------
    system
        The plant.
    state
        Initial state; all nodes of a string start at its mean temperature. Strings start with its state of
        health: what is missing to 1 was lost before, by standing and by cycling as ``wear.calendar_share``
        says.
    plant_step_s
        Inner step [s]; None takes the system's (10 s).
    derating_law
        "table": factor over mean temperature; "pi": the PI law with the system's gains.
    ambient_c
        Air inlet temperature [degC] where a step gives none; None takes the system's.

    Raises
    ------
    InputError
        If the state does not fit the system, or the plant step is not stable (the message names the largest).

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
        self._fleet = Fleet(
            system, [state], plant_step_s=plant_step_s, derating_law=derating_law, ambient_c=ambient_c
        )

    def _facts(self) -> dict[str, str]:
        state = self.state
        return {
            "system": self.system.name,
            "strings": str(self.system.n_strings),
            "soc": few(state.soc),
            "temperature": few(state.temperature_c, ".3g", "°C"),
            "step": f"{self.plant_step_s:g} s",
        }

    __repr__ = one_line
    _repr_html_ = as_table

    @property
    def system(self) -> System:
        """The plant's parameters."""
        return self._fleet.system

    @property
    def plant_step_s(self) -> float:
        """Plant step [s]."""
        return self._fleet.plant_step_s

    @property
    def state(self) -> State:
        """Measured state: SOC, mean temperature and state of health of each string."""
        return self._fleet.states[0]

    def step(
        self,
        request_kw: ArrayLike,
        step_s: float = 900.0,
        *,
        ambient_c: float | None = None,
        reactive_kvar: ArrayLike | None = None,
    ) -> Flows:
        """Advance by one control step.

        Parameters
        ----------
        request_kw
            Set-points [kW], shape ``(n_strings,)``, positive = discharge.
        step_s
            Length of the control step [s], a multiple of the plant step, a day at most.
        ambient_c
            Air inlet temperature [degC]; the plant's own if None.
        reactive_kvar
            Reactive power of each string [kvar], shape ``(n_strings,)``, positive where it is given gives it.

        Returns
        -------
        Flows
            Arrays of shape ``(n_strings,)``, node temperatures included.

        Raises
        ------
        InputError
            As for :meth:`run`.
        """
        request = numbers("request_kw", request_kw, (self.system.n_strings,), "kW")
        air_c = ambient(ambient_c, self._fleet.ambient_c, 1, 1)
        asked = _beside(request, reactive_kvar)
        return self._fleet.advance(request, air_c, step_s, request.shape, nodes=True, reactive_kvar=asked)

    def run(
        self,
        request_kw: ArrayLike,
        step_s: float = 900.0,
        *,
        ambient_c: ArrayLike | None = None,
        nodes: bool = False,
        reactive_kvar: ArrayLike | None = None,
    ) -> Flows:
        """Advance through a horizon in one call; bit by bit the same as one :meth:`step` after the other.

        Parameters
        ----------
        request_kw
            Set-points [kW], shape ``(n_steps, n_strings)``, positive = discharge.
        step_s
            Length of a control step [s], a multiple of the plant step, a day at most.
        ambient_c
            Air inlet temperature [degC], one value or one per step; the plant's own if None.
        nodes
            Keep the node temperatures of every step.
        reactive_kvar
            Reactive power [kvar], shape ``(n_steps, n_strings)``, positive where the inverter gives it.

        Returns
        -------
        Flows
            Arrays of shape ``(n_steps, n_strings)``.

        Raises
        ------
        InputError
            On a wrong shape, NaN, a request or reactive power above nominal power, a step that the plant step
            does not divide, or more than 1e10 plant steps of strings. Nothing has advanced then.
        """
        request = numbers("request_kw", request_kw, ("n_steps", self.system.n_strings), "kW")
        air_c = ambient(ambient_c, self._fleet.ambient_c, 1, request.shape[0])
        asked = _beside(request, reactive_kvar)
        return self._fleet.advance(request, air_c, step_s, request.shape, nodes=nodes, reactive_kvar=asked)

    def follow(
        self,
        controller: ExplicitController,
        ahead_kw: NDArray[np.float64],
        limit_kw: NDArray[np.float64],
        ambient_c: NDArray[np.float64],
        step_s: float,
    ) -> tuple[NDArray[np.float64], Flows]:
        """Advance in closed loop with an explicit controller, in one call of the core.

        Parameters
        ----------
        controller
            Distilled for this plant.
        ahead_kw : ndarray, shape (n_steps, controller.tables.steps)
            Demand [kW] of each step, at most the sum of ``limit_kw``, and as foreseen for the next ones.
        limit_kw : ndarray, shape (n_steps, n_strings)
            Largest power of each inverter [kW].
        ambient_c : ndarray, shape (n_steps,)
            Air inlet temperature [degC].
        step_s
            Length of a control step [s].

        Returns
        -------
        request_kw : ndarray, shape (n_steps, n_strings)
            Set-points [kW].
        flows : Flows
            As of :meth:`run`.

        Raises
        ------
        InputError
            On shapes that do not fit each other, or what :meth:`run` refuses.
        """
        law, shape = controller.core, limit_kw.shape
        with refusals():
            outlook = law.look(np.ascontiguousarray(ahead_kw))[:, None, :]
            demand_kw = np.ascontiguousarray(ahead_kw[:, :1])
            array = law.run(
                self._fleet.core,
                np.array([controller.weights]),
                demand_kw,
                outlook,
                np.ascontiguousarray(limit_kw),
                ambient_c[:, None],
                step_s,
            )
        request_kw = array.pop("request_kw").reshape(shape)
        return request_kw, self._fleet.flows(array, shape)

    def snapshot(self) -> PlantSnapshot:
        """Return everything the plant remembers, to be given to :meth:`restore`."""
        whole = self._fleet.snapshot()
        return PlantSnapshot(
            soc=whole.soc[0],
            node_temperature_c=whole.node_temperature_c[0],
            derating_integral_k=whole.derating_integral_k[0],
            inverter_on=whole.inverter_on[0],
            ageing=whole.ageing[0],
            cooling_stages=None if whole.cooling_stages is None else whole.cooling_stages[0],
            coolant=None if whole.coolant is None else whole.coolant[0],
        )

    def restore(self, snapshot: PlantSnapshot) -> None:
        """Go back (or on) to a snapshot; the plant continues from it bit by bit."""
        self._fleet.restore(snapshot)


def _beside(request_kw: NDArray[np.float64], reactive_kvar: ArrayLike | None) -> NDArray[np.float64] | None:
    """Reactive power in the shape of the requests, if any is asked for."""
    if reactive_kvar is None:
        return None
    return numbers("reactive_kvar", reactive_kvar, request_kw.shape, "kvar")
