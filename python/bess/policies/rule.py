"""Policies without a solver: a rule for sharing, and what all of them have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bess.errors import BessError
from bess.numbers import Array, real_numbers
from bess.parameters import State, System
from bess.policies.capability import Capability
from bess.policies.policy import NO_OPTIMISATION, Decision, Situation


@dataclass(frozen=True)
class StepDemand:
    """A demand to share in one direction; powers are magnitudes [kW].

    Attributes
    ----------
    demand_kw : float
        Total to share.
    discharge : bool
        Direction.
    capability_kw : ndarray, shape (n_strings,)
        What each string can take over the whole step without shedding.
    state : State
        Measured state.
    """

    demand_kw: float
    discharge: bool
    capability_kw: Array
    state: State


Share = Callable[[System, StepDemand], Array]
"""A rule: powers [kW] up to each string's capability, in total the demand or, if less, all they can take."""


class RulePolicy:
    """Shares every step's demand by a rule, without looking ahead.

    What no string can take is requested all the same, spread over the free inverter power, so that the plant
    records it as lost availability.
    """

    statuses: Mapping[int, str] = {NO_OPTIMISATION: "no optimisation needed"}

    def __init__(self, system: System, dt_h: float, share: Share) -> None:
        self._system = system
        self._share = share
        self._capability = Capability(system, dt_h)

    def __call__(self, situation: Situation) -> Decision:
        """Share the demand of this step.

        Raises
        ------
        BessError
            The rule returned not one power for each string.
        """
        demand_kw = float(situation.demand_kw[0])
        limit_kw = situation.limit_kw
        if demand_kw == 0.0:
            return Decision(np.zeros_like(limit_kw))
        discharge = demand_kw > 0.0
        capability_kw = np.minimum(self._capability(situation, discharge), limit_kw)
        asked = StepDemand(abs(demand_kw), discharge, capability_kw, situation.state)
        shares_kw = real_numbers(self._share(self._system, asked))
        if shares_kw.shape != limit_kw.shape:
            raise BessError(
                f"the rule returned powers of shape {shares_kw.shape}, needs {limit_kw.shape}, one for each "
                "string"
            )
        power_kw = np.minimum(shares_kw, limit_kw)
        rest_kw = asked.demand_kw - float(power_kw.sum())
        if rest_kw > 0.0:
            free_kw = limit_kw - power_kw
            power_kw = np.minimum(power_kw + water_fill(rest_kw, free_kw, free_kw), limit_kw)
        power_kw = self._system.control_at(situation.state).set_points(power_kw, limit_kw)
        return Decision(np.copysign(power_kw, demand_kw))

    def memory(self) -> dict[str, Any]:
        """Nothing: a rule looks at the situation only."""
        return {}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Nothing to restore."""


def water_fill(total_kw: float, weights: Array, caps_kw: Array) -> Array:
    """Share ``total_kw`` in proportion to ``weights``; what would exceed a cap goes to the others.

    A proportional form of water filling [1]_: shares rise together until caps hold some of them back.

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
    power_kw = np.zeros(caps_kw.size)
    open_ = caps_kw > 0.0
    rest_kw = total_kw
    while rest_kw > 0.0 and open_.any():
        share = open_ * weights
        whole = share.sum()
        if whole <= 0.0:
            share = open_ * caps_kw
            whole = share.sum()
        wanted_kw = power_kw + rest_kw * (share / whole)
        over = open_ & (wanted_kw >= caps_kw)
        if not over.any():
            return np.asarray(wanted_kw)
        power_kw = np.where(over, caps_kw, power_kw)
        open_ &= ~over
        rest_kw = total_kw - float(power_kw.sum())
    return power_kw
