"""What a driven plant shall give, and from where that is known."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.simulation.demand import StepInputs
from bess.simulation.inputs import prepare
from bess.study import Study
from bess.study.demands import ProfileDemand


@dataclass(frozen=True)
class ActiveDemand:
    """A demand at one moment.

    Attributes
    ----------
    demand_kw : float
        Now, positive = discharge.
    forecast_kw : list of float or None
        Mean of the present step of the plan and of the next ones.
    source : str
        Where it is from, for people.
    """

    demand_kw: float
    forecast_kw: list[float] | None
    source: str


class Demands:
    """The demand that was posted last, while it is valid; else none, or the study's profile if it says so.

    With ``service.follow_profile`` the profile stands where its times say; one that repeats
    (``demand.repeat``) goes on before and after them. Where nothing is known there is no demand, which is
    something else than a demand of zero: the plant is let go.

    Parameters
    ----------
    study
        Whose profile.
    plan_s
        Step of the plan [s].

    Raises
    ------
    InputError
        If the study wants its profile to be followed and has none.
    """

    def __init__(self, study: Study, plan_s: float) -> None:
        self._plan_s = plan_s
        self._posted: tuple[list[float], bool, float, float, str] | None = None
        self._lock = threading.Lock()
        self._profile: Array | None = None
        self._repeats = False
        if not study.service.follow_profile:
            return
        if not isinstance(study.demand, ProfileDemand):
            raise InputError(
                f"{study.name}: service.follow_profile = true, and [demand] is of kind "
                f'"{study.demand.kind}"; give a demand of kind "profile", or leave the key out'
            )
        inputs = prepare(study.with_values({"demand.forecast": "perfect"}))
        now = StepInputs(
            inputs.system.initial_state(),
            inputs.limit_kw[0],
            inputs.system.surroundings_c(inputs.ambient_c),
        )
        self._profile = inputs.demand.ahead(0, inputs.grid.n_steps, now)
        self._start_s, self._step_s = inputs.grid.start_s, inputs.grid.step_s
        self._repeats = study.demand.repeat

    def post(self, demand_kw: float | list[float], valid_for_s: float, now_s: float, by: str = "") -> None:
        """Take over a demand, or a forecast that begins now, from a caller at an address."""
        is_list = isinstance(demand_kw, list)
        values = list(demand_kw) if isinstance(demand_kw, list) else [demand_kw]
        with self._lock:
            self._posted = (values, is_list, now_s, now_s + valid_for_s, by)

    def at(self, now_s: float, n_steps: int) -> ActiveDemand | None:
        """The demand now, and as far ahead as is known; None if there is none."""
        with self._lock:
            posted = self._posted
        if posted is not None and now_s < posted[3]:
            values, is_list, began_s, until_s, by = posted
            gone = int(now_s // self._plan_s) - int(began_s // self._plan_s) if is_list else 0
            if gone < len(values):
                left = values[gone:]
                source = f"posted{by and f' by {by}'}, valid for another {until_s - now_s:.0f} s"
                return ActiveDemand(left[0], left if is_list else None, source)
        if self._profile is None:
            return None
        first = int((now_s - self._start_s) // self._step_s)
        steps = first + np.arange(n_steps)
        if self._repeats:
            ahead = self._profile[steps % self._profile.size]
        elif 0 <= first < self._profile.size:
            ahead = self._profile[first : first + n_steps]
        else:
            return None
        return ActiveDemand(float(ahead[0]), ahead.tolist(), "the profile of the study")
