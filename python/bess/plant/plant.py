"""One plant, the simulated system of the closed loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.control.explicit import ExplicitController
from bess.display import as_table, few, one_line
from bess.plant.ensemble import PlantEnsemble
from bess.plant.flows import Flows
from bess.plant.inputs import ambient, numbers, refusals
from bess.plant.snapshot import PlantSnapshot
from bess.system import State, System


class Plant:
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
        The state does not fit the system, or the plant step is unstable (the message gives the maximum).

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
        self._fleet = PlantEnsemble(
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
            Reactive power of each string [kvar], shape ``(n_strings,)``, positive = supplied.

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
        """Advance through a horizon in one call, with the same results as repeated :meth:`step` calls.

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
            Reactive power [kvar], shape ``(n_steps, n_strings)``, positive = supplied.

        Returns
        -------
        Flows
            Arrays of shape ``(n_steps, n_strings)``.

        Raises
        ------
        InputError
            Wrong shape, NaN, a request or reactive power above nominal power, a step that is not a multiple
            of the plant step, or more than 1e10 plant steps x strings. The state is then unchanged.
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
            Controller distilled for this plant.
        ahead_kw : ndarray, shape (n_steps, controller.tables.steps)
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

    def renew(self, strings: NDArray[np.bool_]) -> None:
        """Replace the batteries of some strings by new ones, at their SOC and temperature.

        Parameters
        ----------
        strings : ndarray of bool, shape (n_strings,)
            The strings whose state of health becomes 1 and whose past cycles are forgotten.
        """
        state, old = self.state, self.snapshot()
        new = PlantEnsemble(self.system, [State(state.soc, state.temperature_c)]).snapshot().ageing[0]
        rows = np.zeros((new.shape[0], max(new.shape[1], old.ageing.shape[1])))
        for each, chosen in ((old.ageing, ~strings), (new, strings)):
            rows[chosen, : each.shape[1]] = each[chosen]
        self.restore(replace(old, ageing=rows))

    def snapshot(self) -> PlantSnapshot:
        """Return the complete state of the plant, for :meth:`restore`."""
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
        """Restore a snapshot; the plant continues from it to the last bit."""
        self._fleet.restore(snapshot)


def _beside(request_kw: NDArray[np.float64], reactive_kvar: ArrayLike | None) -> NDArray[np.float64] | None:
    """Reactive power in the shape of the requests, if given."""
    if reactive_kvar is None:
        return None
    return numbers("reactive_kvar", reactive_kvar, request_kw.shape, "kvar")
