"""The plan of the live controller: forecast, background update, and its effect on set-points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Generic, TypeVar

import numpy as np

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.control.policies import Policy, PolicyInput
from bess.edge.serve import LOG
from bess.edge.serve.commitment import Curves
from bess.study.events import limits_of
from bess.study.grid import TimeGrid
from bess.study.sections import Event
from bess.system import State, System

T = TypeVar("T")

SMOOTH_S: Final = 300.0
"""Time constant for smoothing a fluctuating demand."""
CHANGED: Final = 0.05
"""Change of limits or forecast, as a share of the plant's power, that requires a new plan."""
REPLAN_S: Final = 30.0
"""Minimum time between two plans of the same step."""
NOT_PLANNED: Final = 0.005
"""Additional cost of a kWh through a string that the plan does not use, in kWh of losses."""
MAX_MARGINAL_LOSS: Final = 0.02
"""Maximum difference of marginal losses that is derived from a plan."""


class DemandForecast(Checkpointed):
    """Forecast by the mean demand of each step of the day before.

    ``step_s`` is the control step, ``plan_s`` the step of the plan [s], ``n_steps`` the plan's horizon.
    """

    _carried = ("_day_kw", "_mean", "_smooth_kw")

    def __init__(self, step_s: float, plan_s: float, n_steps: int) -> None:
        self._step_s, self._n_steps = step_s, n_steps
        self._day_kw: Array = np.full(max(1, round(86_400.0 / plan_s)), np.nan)
        # Present step of the plan: its number, mean demand so far [kW], time so far [s].
        self._mean: tuple[int, float, float] = (-1, 0.0, 0.0)
        self._smooth_kw: float | None = None

    def __call__(
        self, demand_kw: float, slot: int, elapsed_s: float, given_kw: Sequence[float] | Array | None
    ) -> Array:
        """Record the demand and return the forecast [kW], shape ``(n_steps,)``, with the present step first.

        ``slot`` is the number of the present step of the plan, ``elapsed_s`` the time since the last call,
        and ``given_kw`` the forecast of the caller, zero after its end.
        """
        self._record(demand_kw, slot, elapsed_s)
        if given_kw is not None:
            ahead = np.asarray(given_kw, dtype=np.float64)[: self._n_steps]
            return np.concatenate([ahead, np.zeros(self._n_steps - ahead.size)])
        ahead = self._day_before(slot, self._n_steps)
        weight = 1.0 if self._smooth_kw is None else min(1.0, self._step_s / SMOOTH_S)
        self._smooth_kw = (1.0 - weight) * (self._smooth_kw or 0.0) + weight * demand_kw
        ahead[0] = self._smooth_kw
        return ahead

    def day(self, slot: int, given_kw: Sequence[float] | Array | None) -> Array:
        """Demand of a day in steps of the plan: the forecast of the caller, then that of the day before."""
        ahead = self._day_before(slot, self._day_kw.size)
        given = np.array([] if given_kw is None else given_kw, dtype=np.float64)[: ahead.size]
        ahead[: given.size] = given
        return ahead

    def _day_before(self, slot: int, n_steps: int) -> Array:
        return np.nan_to_num(self._day_kw[(slot + np.arange(n_steps)) % self._day_kw.size])

    def _record(self, demand_kw: float, slot: int, elapsed_s: float) -> None:
        known, mean, weight_s = self._mean
        if slot != known:
            if known >= 0:
                self._day_kw[known % self._day_kw.size] = mean
            mean, weight_s = 0.0, 0.0
        span_s = max(min(elapsed_s, self._step_s), 1e-3)
        mean = (mean * weight_s + demand_kw * span_s) / (weight_s + span_s)
        self._mean = (slot, mean, weight_s + span_s)


class Background(Generic[T]):
    """One call at a time in a thread of ``pool``, or at once without one.

    ``error`` is the failure of the last call, in a sentence; the log has its trace once.
    """

    def __init__(self, pool: ThreadPoolExecutor | None, what: str) -> None:
        self._pool, self._what = pool, what
        self._pending: Future[T] | None = None
        self.error = ""

    @property
    def is_busy(self) -> bool:
        """Whether there is a call whose result is not collected."""
        return self._pending is not None

    def begin(self, call: Callable[..., T], *arguments: Any) -> None:
        """Begin a call."""
        if self._pool is not None:
            self._pending = self._pool.submit(call, *arguments)
            return
        self._pending = Future()
        try:
            self._pending.set_result(call(*arguments))
        except Exception as error:
            self._pending.set_exception(error)

    def collect(self, wait_s: float = 0.0) -> T | None:
        """The result of a call that ends within ``wait_s``, once; None otherwise, and if it failed."""
        if self._pending is None:
            return None
        try:
            failure = self._pending.exception(wait_s)
        except TimeoutError:
            return None
        ended, self._pending = self._pending, None
        if failure is None:
            self.error = ""
            return ended.result()
        error = f"{self._what} failed ({type(failure).__name__}: {failure})"
        if error != self.error:
            LOG.warning(error, exc_info=failure)
        self.error = error
        return None


@dataclass(frozen=True)
class ActivePlan:
    """A plan of the policy."""

    slot: int
    """Number of its first step since the epoch of the controller's clock."""
    request_kw: Array
    """Set-points of the strings, in one step or more of the forecast."""
    demand_kw: Array
    """``(n_steps,)``: demand for which it was made, with the forecast."""
    limit_kw: Array
    """``(n_strings,)``: power of each string in service."""
    gap: float | None
    """Gap of its first step to a rigorous bound, if the policy has one."""


class CarriedPlan(Checkpointed):
    """Keeps the plan of a policy up to date: in each of its steps, and after a change within a step.

    A thread of ``pool`` computes the plans, so no answer waits longer than permitted; without a pool, the
    caller waits. Plans know the outages and limits of ``events`` beforehand.
    """

    _carried = ("_before", "_after", "_asked_at_s", "current")
    _classes: ClassVar = {"current": ActivePlan}

    def __init__(
        self,
        system: System,
        policy: Policy,
        n_steps: int,
        pool: ThreadPoolExecutor | None,
        events: tuple[Event, ...] = (),
    ) -> None:
        self._system, self._policy, self._events = system, policy, events
        self.step_s, self.n_steps = system.control.step_s, n_steps
        self.making = Background[ActivePlan](pool, "the last plan")
        self._asked: tuple[int, Array, Array] | None = None
        self._asked_at_s = -np.inf
        # State of the policy before and after its plan of the present step.
        self._before: dict[str, Any] = policy.state_dict()
        self._after = self._before
        self.current: ActivePlan | None = None

    def slot(self, now_s: float) -> int:
        """Return the number of the plan step that contains ``now_s``."""
        return int(now_s // self.step_s)

    def update(
        self, now_s: float, state: State, forecast_kw: Array, limit_kw: Array, *, wait_s: float = 0.0
    ) -> None:
        """Begin a new plan if one is due, and wait for it up to ``wait_s``.

        ``forecast_kw`` ``(n_steps,)`` begins with the present step; ``limit_kw`` is the power of each string
        in service.
        """
        self.current = self.making.collect() or self.current
        if not self.making.is_busy and self._is_due(now_s, forecast_kw, limit_kw):
            slot = self.slot(now_s)
            gone = 0 if self._asked is None else slot - self._asked[0]
            self._asked, self._asked_at_s = (slot, forecast_kw, limit_kw), now_s
            self.making.begin(self._make, slot, gone, state, forecast_kw, limit_kw)
            self.current = self.making.collect(wait_s) or self.current

    def from_now(self, now_s: float) -> Array | None:
        """Set-points from the present step on, shape ``(n_strings, n_left)``; None without a plan."""
        offset = 0 if self.current is None else self.slot(now_s) - self.current.slot
        if self.current is None or not 0 <= offset < self.current.request_kw.shape[1]:
            return None
        return self.current.request_kw[:, offset:]

    def gap(self, request_kw: Array, now_s: float) -> float | None:
        """Gap of set-points to a rigorous bound, if they are those of a plan of this step."""
        plan = self.current
        if plan is None or plan.slot != self.slot(now_s):
            return None
        return plan.gap if np.allclose(request_kw, plan.request_kw[:, 0], rtol=1e-6, atol=1e-6) else None

    def ahead(
        self, request_kw: Array, forecast_kw: Sequence[float] | Array | None, now_s: float, limit_kw: Array
    ) -> Array:
        """Present set-points, then shares of the forecast as in the plan, ``(n_strings, n_steps)``."""
        if forecast_kw is None or len(forecast_kw) < 2:
            return request_kw[:, None]
        demand = np.asarray(forecast_kw, dtype=np.float64)
        most = self._limit_ahead_kw(self.slot(now_s), limit_kw, demand.size)
        planned = np.zeros(most.shape)
        known = self.from_now(now_s)
        if known is not None:
            n = min(known.shape[1], demand.size)
            planned[:, :n] = np.minimum(np.abs(known[:, :n]), most[:, :n])
        wanted = np.abs(demand)
        power = np.where(planned.any(axis=0), planned, most)
        power = power * np.minimum(1.0, wanted / np.maximum(power.sum(axis=0), 1e-12))
        # Demand above the plan is shared by headroom.
        room = most - power
        rest = np.maximum(wanted - power.sum(axis=0), 0.0)
        power = power + room * np.minimum(1.0, rest / np.maximum(room.sum(axis=0), 1e-12))
        shares = np.asarray(np.copysign(power, demand))
        shares[:, 0] = request_kw
        return shares

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        super().load_state_dict(state_dict)
        self._policy.load_state_dict(self._after)
        if self.current is not None:
            self._asked = (self.current.slot, self.current.demand_kw, self.current.limit_kw)

    def _limit_ahead_kw(self, slot: int, limit_kw: Array, n_steps: int) -> Array:
        """Expected power of each string in the steps from ``slot`` on, ``(n_strings, n_steps)``."""
        grid = TimeGrid(round(slot * self.step_s), round(self.step_s), n_steps)
        announced_kw = limits_of(self._events, self._system, grid)
        # A limit that was not announced is expected to last.
        unannounced_kw = np.where(limit_kw < announced_kw[0], limit_kw, np.inf)
        return np.minimum(announced_kw, unannounced_kw).T

    def _is_due(self, now_s: float, forecast_kw: Array, limit_kw: Array) -> bool:
        if self._asked is None or self.slot(now_s) != self._asked[0]:
            return True
        if now_s - self._asked_at_s < REPLAN_S:
            return False
        _, forecast, limit = self._asked
        nominal_kw = self._system.nominal_kw
        return bool(
            np.abs(limit - limit_kw).max() > CHANGED * nominal_kw.max()
            or np.abs(forecast - forecast_kw).max() > CHANGED * float(nominal_kw.sum())
        )

    def _make(self, slot: int, gone: int, state: State, forecast_kw: Array, limit_kw: Array) -> ActivePlan:
        limit_ahead = self._limit_ahead_kw(slot, limit_kw, self.n_steps)
        total = limit_ahead.sum(axis=0)
        served = np.clip(forecast_kw, -total, total)
        ambient = np.full(self.n_steps, self._system.reference_temperature_c)
        if gone <= 0:
            self._policy.load_state_dict(self._before)  # the same step again, or a clock that was set back
        for _ in range(min(gone, self.n_steps) - 1):  # steps without a call
            self._policy(PolicyInput(state, np.zeros(self.n_steps), ambient, limit_kw))
        self._before = self._policy.state_dict()
        decision = self._policy(
            PolicyInput(state, served, ambient, limit_ahead[:, 0], limit_ahead_kw=limit_ahead)
        )
        self._after = self._policy.state_dict()
        plan_kw = decision.request_kw[:, None] if decision.plan_kw is None else decision.plan_kw
        request = np.array(plan_kw, dtype=np.float64)
        gap = float(decision.solver.gap) if np.isfinite(decision.solver.gap) else None
        return ActivePlan(slot, request, forecast_kw, limit_kw, gap)


def preferences(planned_kw: Array | None, curves: Curves, discharge: bool) -> Array:
    """Prices [kW/kW] at which the plan's shares have equal marginal costs; unplanned strings cost more.

    ``curves`` are the losses in the direction of the demand.
    """
    if planned_kw is None or not planned_kw.any():
        return np.zeros(curves.slope.size)
    power = np.abs(planned_kw)
    marginal = curves.marginal(power)
    mean = float((marginal * power).sum() / power.sum())
    price = np.clip(mean - marginal, -MAX_MARGINAL_LOSS, MAX_MARGINAL_LOSS)
    if (float(planned_kw.sum()) > 0.0) != discharge:
        price = -price  # a string preferred in one direction is to be spared in the other
    return np.where(power > 0.0, price, NOT_PLANNED)
