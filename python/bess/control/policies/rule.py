"""Rule-based policies without a solver: common implementation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bess import _core
from bess.arrays import Array, real_numbers
from bess.checkpoints import Checkpointed
from bess.control.policies.policy import NO_OPTIMISATION, Decision, PolicyInput
from bess.errors import BessError
from bess.system import State, System


@dataclass(frozen=True)
class StepDemand:
    """A demand in one direction; powers are magnitudes [kW].

    Attributes
    ----------
    demand_kw : float
        Total demand.
    discharge : bool
        Direction.
    capability_kw : ndarray, shape (n_strings,)
        Power that each string can sustain over the whole step.
    state : State
        Measured state.
    """

    demand_kw: float
    discharge: bool
    capability_kw: Array
    state: State


Share = Callable[[System, StepDemand], Array]
"""A rule: powers [kW] within the capability of each string, in total the demand or the total capability."""


class RulePolicy(Checkpointed):
    """Allocates the demand of every step by a rule, without forecast.

    Demand above the total capability is also requested, within the free inverter power, so that the plant
    records it as availability loss.

    Parameters
    ----------
    system : System
        The plant.
    dt_h : float
        Control step [h].
    share : callable or str
        The rule, or the name of a bundled one, which runs in the core.
    """

    statuses: Mapping[int, str] = {NO_OPTIMISATION: "no optimisation needed"}

    def __init__(self, system: System, dt_h: float, share: Share | str) -> None:
        self._system = system
        self._share = share
        self._dt_h = dt_h
        self._law = None
        if isinstance(share, str):
            stop_c = np.array([string.derating.stop_c for string in system.strings])
            sizes = system.nominal_kw, system.nominal_energy_kwh
            self._law = _core.Rule(system.core, share, dt_h, *sizes, stop_c)

    @property
    def controller(self) -> RulePolicy | None:
        """See :meth:`bess.Plant.run_controller`; None for a rule written in Python."""
        return None if self._law is None else self

    def run(
        self, plant: _core.Plant, ahead_kw: Array, limit_kw: Array, ambient_c: Array, step_s: float
    ) -> dict[str, Array]:
        """See :class:`bess.plant.plant.CoreController`."""
        assert self._law is not None
        return self._law.run(plant, ahead_kw[:, 0].copy(), limit_kw, ambient_c, step_s)

    def __call__(self, inputs: PolicyInput) -> Decision:
        """Allocate the demand of this step.

        Raises
        ------
        BessError
            The rule did not return one power for each string.
        """
        demand_kw = float(inputs.demand_kw[0])
        limit_kw = real_numbers(inputs.limit_kw)
        if self._law is not None:
            return Decision(self._law.split(inputs.state, limit_kw, demand_kw))
        if demand_kw == 0.0:
            return Decision(np.zeros_like(limit_kw))
        discharge, state = demand_kw > 0.0, inputs.state
        model = self._system.control_at(state)
        max_kw = model.deliverable_kw(state.soc, state.temperature_c, discharge, self._dt_h)
        capability_kw = np.clip(max_kw, 0.0, np.minimum(self._system.nominal_kw, limit_kw))
        task = StepDemand(abs(demand_kw), discharge, capability_kw, state)
        assert callable(self._share)
        shares_kw = real_numbers(self._share(self._system, task))
        if shares_kw.shape != limit_kw.shape:
            raise BessError(
                f"the rule returned powers of shape {shares_kw.shape}, needs {limit_kw.shape}, one for each "
                "string"
            )
        power_kw = np.minimum(shares_kw, limit_kw)
        rest_kw = task.demand_kw - float(power_kw.sum())
        if rest_kw > 0.0:
            free_kw = limit_kw - power_kw
            power_kw = np.minimum(power_kw + water_fill(rest_kw, free_kw, free_kw), limit_kw)
        power_kw = model.set_points(power_kw, limit_kw)
        return Decision(np.copysign(power_kw, demand_kw))


def water_fill(total_kw: float, weights: Array, caps_kw: Array) -> Array:
    """Allocate ``total_kw`` in proportion to ``weights``; power above a cap goes to the others.

    A proportional form of water filling [1]_: shares rise together until they reach their caps.

    Returns
    -------
    ndarray, shape (n,)
        Powers [kW], each at most its cap, in total ``min(total_kw, caps_kw.sum())``. Strings without weight
        get power only when all others are at their caps.

    References
    ----------
    .. [1] Boyd, S., Vandenberghe, L.: Convex optimization. Cambridge University Press, 2004, section 5.5.3
       (water filling).
    """
    return _core.water_fill(total_kw, real_numbers(weights), real_numbers(caps_kw))
