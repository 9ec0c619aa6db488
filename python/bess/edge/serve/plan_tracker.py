"""What the live controller takes from the plan: its shares while the demand is near, else its preferences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from bess.arrays import Array
from bess.edge.serve.carried_plan import CarriedPlan
from bess.edge.serve.commitment import Curves
from bess.edge.serve.persistent import Persistent

NOT_PLANNED: Final = 0.005
"""What a kWh through a string that the plan leaves out counts more, in kWh lost."""
NEAR: Final = 0.1
"""Relative distance from the demand of the plan within which the shares are the plan's."""
NEAR_S: Final = 60.0
"""How long the demand must have been that near."""
STEEPEST: Final = 0.02
"""Largest difference of marginal losses that is read out of a plan."""


class PlanTracker(Persistent):
    """Follows a plan while the demand stays near that of the plan.

    A demand that only passes there must not switch anything, so it has to stay for a while.

    Parameters
    ----------
    plan
        Which one.
    step_s
        Control step [s].
    """

    kept = ("near_s",)

    def __init__(self, plan: CarriedPlan, step_s: float) -> None:
        self._plan, self._step_s = plan, step_s
        self.near_s = 0.0

    def shares(
        self, planned_kw: Array | None, demand_kw: float, most_kw: Array, elapsed_s: float
    ) -> Array | None:
        """Magnitudes in the proportions of the plan; None if the plan is not to be followed now.

        Parameters
        ----------
        planned_kw
            Set-points of the plan for now; None without one.
        demand_kw
            Now, signed.
        most_kw
            What each string can take in the direction of the demand.
        elapsed_s
            Time since the last call.
        """
        plan_kw = 0.0 if planned_kw is None else float(planned_kw.sum())
        is_near = abs(demand_kw - plan_kw) <= NEAR * abs(plan_kw)
        self.near_s = self.near_s + elapsed_s if is_near else 0.0
        if planned_kw is None or not is_near or self.near_s + self._step_s < min(NEAR_S, self._plan.step_s):
            return None
        wanted = np.abs(planned_kw) * (abs(demand_kw) / abs(plan_kw) if plan_kw else 0.0)
        # Where it does not fit any more, the least loss decides.
        return wanted if (wanted <= most_kw * (1.0 + 1e-9)).all() else None


def preferences(planned_kw: Array | None, curves: Curves, discharge: bool) -> Array:
    """Prices [kW/kW] by which the plan's shares have equal marginal costs; what it leaves out costs more.

    Parameters
    ----------
    planned_kw
        Set-points of the plan for now; None without one.
    curves
        Losses of the strings in the direction of the demand.
    discharge
        That direction.
    """
    if planned_kw is None or not planned_kw.any():
        return np.zeros(curves.slope.size)
    power = np.abs(planned_kw)
    marginal = curves.marginal(power)
    mean = float((marginal * power).sum() / power.sum())
    price = np.clip(mean - marginal, -STEEPEST, STEEPEST)
    if (float(planned_kw.sum()) > 0.0) != discharge:
        price = -price  # who should give more should take less
    return np.where(power > 0.0, price, NOT_PLANNED)


def ahead(
    plan: CarriedPlan,
    request_kw: Array,
    forecast_kw: Sequence[float] | Array | None,
    now_s: float,
    limit_kw: Array,
) -> Array:
    """The set-points, and shares like the plan's of what is foreseen, shape ``(n_strings, n_steps)``.

    Parameters
    ----------
    plan
        The one in force.
    request_kw
        Set-points of now.
    forecast_kw
        Demand of the present step and those after it; None for nothing but now.
    now_s
        Time of the controller's clock.
    limit_kw
        Power of each string in service.
    """
    if forecast_kw is None or len(forecast_kw) < 2:
        return request_kw[:, None]
    demand = np.asarray(forecast_kw, dtype=np.float64)
    most = limit_kw[:, None]
    planned = np.zeros((request_kw.size, demand.size))
    known = plan.from_now(now_s)
    if known is not None:
        known = np.minimum(np.abs(known[:, : demand.size]), most)
        planned[:, : known.shape[1]] = known
    wanted = np.abs(demand)
    power = np.where(planned.any(axis=0), planned, most)
    power = power * np.minimum(1.0, wanted / np.maximum(power.sum(axis=0), 1e-12))
    # What the plan leaves open goes where there is room.
    room = most - power
    rest = np.maximum(wanted - power.sum(axis=0), 0.0)
    power = power + room * np.minimum(1.0, rest / np.maximum(room.sum(axis=0), 1e-12))
    shares = np.asarray(np.copysign(power, demand))
    shares[:, 0] = request_kw
    return shares
