"""The plan beneath the live controller: kept at its own step, made aside, carried from step to step."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as Late
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from bess.arrays import Array
from bess.control.policies import Policy, PolicyInput
from bess.edge.serve.persistent import Persistent, from_json, to_json
from bess.errors import BessError
from bess.system import State, System

CHANGED: Final = 0.05
"""Share of the plant's power by which limits or a forecast must change before the plan is made anew."""
REPLAN_S: Final = 30.0
"""Shortest time between two plans of the same step."""


@dataclass(frozen=True)
class Plan:
    """A plan from one of its steps on.

    Attributes
    ----------
    slot : int
        Number of its first step since the epoch of the controller's clock.
    request_kw : ndarray, shape (n_strings, n_steps)
        Set-points.
    demand_kw : ndarray, shape (n_steps,)
        What it was made for.
    limit_kw : ndarray, shape (n_strings,)
        Power of each string in service.
    gap : float or None
        Of its first step to a proven bound, from a policy that knows one.
    """

    slot: int
    request_kw: Array
    demand_kw: Array
    limit_kw: Array
    gap: float | None


class CarriedPlan(Persistent):
    """Keeps a policy's plan up to date.

    Parameters
    ----------
    system
        The plant's parameters.
    policy
        Called once for each of its steps, and again within a step if the situation has changed.
    step_s, n_steps
        Of the policy.
    background
        Make plans in a thread of their own, so that no answer waits for one longer than it is told to.
    """

    kept = ("_before", "_after", "_asked_at_s")

    def __init__(
        self, system: System, policy: Policy, step_s: float, n_steps: int, *, background: bool
    ) -> None:
        self._system, self._policy = system, policy
        self.step_s, self.n_steps = step_s, n_steps
        self._pool = ThreadPoolExecutor(1, "plan") if background else None
        self._pending: Future[Plan] | None = None
        self._asked: tuple[int, Array, Array] | None = None
        self._asked_at_s = -np.inf
        # Of the policy, before and after its plan of the present step.
        self._before: dict[str, Any] = policy.memory()
        self._after = self._before
        self.current: Plan | None = None
        self.error = ""

    def slot(self, now_s: float) -> int:
        """Number of the step of the plan that holds at a time."""
        return int(now_s // self.step_s)

    def update(
        self, now_s: float, state: State, forecast_kw: Array, limit_kw: Array, *, wait_s: float = 0.0
    ) -> bool:
        """Begin a new plan if one is due, and wait for it as long as is allowed.

        Parameters
        ----------
        now_s
            Time of the controller's clock.
        state
            Of the strings, now.
        forecast_kw : ndarray, shape (n_steps,)
            Demand of this step of the plan and the next ones.
        limit_kw : ndarray, shape (n_strings,)
            Power of each string in service.
        wait_s
            How long the caller has time.

        Returns
        -------
        bool
            Whether a new plan is in force.
        """
        new = self._collect(0.0)
        if self._pending is None and self._is_due(now_s, forecast_kw, limit_kw):
            self._begin(now_s, state, forecast_kw, limit_kw)
            new = self._collect(wait_s) or new
        return new

    def column(self, now_s: float) -> int | None:
        """Column of the plan that holds now; None if there is none."""
        if self.current is None:
            return None
        offset = self.slot(now_s) - self.current.slot
        return offset if 0 <= offset < self.current.demand_kw.size else None

    def from_now(self, now_s: float) -> Array | None:
        """Set-points from the step that holds now on, shape ``(n_strings, n_left)``; None without any."""
        column = self.column(now_s)
        return None if column is None or self.current is None else self.current.request_kw[:, column:]

    def gap(self, request_kw: Array, now_s: float) -> float | None:
        """Distance to a proven bound of set-points that are those of a plan that was made in this step."""
        planned, plan = self.from_now(now_s), self.current
        if planned is None or plan is None or plan.slot != self.slot(now_s):
            return None
        return plan.gap if np.allclose(request_kw, planned[:, 0], rtol=1e-6, atol=1e-6) else None

    def memory(self) -> dict[str, Any]:
        """What continues the plan in another process."""
        return super().memory() | {"plan": None if self.current is None else to_json(vars(self.current))}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
        super().recall(memory)
        self._policy.recall(self._after)
        plan = from_json(memory["plan"])
        self.current = None if plan is None else Plan(**plan)
        if self.current is not None:
            self._asked = (self.current.slot, self.current.demand_kw, self.current.limit_kw)

    def close(self) -> None:
        """End the thread."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def _is_due(self, now_s: float, forecast_kw: Array, limit_kw: Array) -> bool:
        if self._asked is None or self.slot(now_s) != self._asked[0]:
            return True
        if now_s - self._asked_at_s < REPLAN_S:
            return False
        _, forecast, limit = self._asked
        whole = CHANGED * float(self._system.nominal_kw.sum())
        return bool(
            np.abs(limit - limit_kw).max() > CHANGED * self._system.nominal_kw.max()
            or np.abs(forecast - forecast_kw).max() > whole
        )

    def _begin(self, now_s: float, state: State, forecast_kw: Array, limit_kw: Array) -> None:
        slot = self.slot(now_s)
        gone = 0 if self._asked is None else slot - self._asked[0]
        self._asked, self._asked_at_s = (slot, forecast_kw, limit_kw), now_s
        if self._pool is None:
            self._pending = Future()
            self._pending.set_result(self._make(slot, gone, state, forecast_kw, limit_kw))
        else:
            self._pending = self._pool.submit(self._make, slot, gone, state, forecast_kw, limit_kw)

    def _collect(self, wait_s: float) -> bool:
        if self._pending is None or (wait_s == 0.0 and not self._pending.done()):
            return False
        try:
            self.current, self.error = self._pending.result(timeout=wait_s), ""
        except Late:
            return False
        except (BessError, ArithmeticError, ValueError) as error:
            self._pending, self.error = None, str(error)
            return False
        self._pending = None
        return True

    def _make(self, slot: int, gone: int, state: State, forecast_kw: Array, limit_kw: Array) -> Plan:
        total = limit_kw.sum()
        served = np.clip(forecast_kw, -total, total)
        ambient = np.full(self.n_steps, self._system.reference_temperature_c)
        if gone <= 0:
            self._policy.recall(self._before)  # the same step again, or a clock that was set back
        for _ in range(min(gone, self.n_steps) - 1):  # steps in which nobody asked
            self._policy(PolicyInput(state, np.zeros(self.n_steps), ambient, limit_kw))
        self._before = self._policy.memory()
        decision = self._policy(PolicyInput(state, served, ambient, limit_kw))
        self._after = self._policy.memory()
        plan_kw = decision.request_kw[:, None] if decision.plan_kw is None else decision.plan_kw
        request = np.array(plan_kw, dtype=np.float64)
        gap = float(decision.solver.gap)
        return Plan(slot, request, served[: request.shape[1]], limit_kw, gap if np.isfinite(gap) else None)
