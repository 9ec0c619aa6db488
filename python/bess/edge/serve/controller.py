"""The live controller: measured strings and a demand in, set-points and their reasons out.

Beneath it a policy keeps its plan at the control step of the system, a quarter of an hour as a rule. Each
control step of a second or more goes one way, which :meth:`Controller.step` shows:

measurements -> what may be trusted of them (:mod:`bess.edge.serve.measurement_validator`) -> the plan, if a
new one is due (:mod:`bess.edge.serve.carried_plan`) -> what the strings can take and give
(:mod:`bess.edge.serve.soc_limits`) -> a string that is being calibrated (:mod:`bess.edge.serve.calibration`)
-> which inverters run: those of the plan while it fits (:mod:`bess.edge.serve.plan_tracker`), else by
:mod:`bess.edge.serve.commitment` -> set-points that hold to everything (:mod:`bess.edge.serve.constraints`).

Nothing here waits for a plan longer than it is told to.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from bess.arrays import Array, Flags
from bess.control.policies import Policy
from bess.control.policies.rule import water_fill
from bess.edge.plant_io import Measurements
from bess.edge.serve.ageing import Ageing
from bess.edge.serve.answer import Answer, Counters, unmet
from bess.edge.serve.calibration import Calibration
from bess.edge.serve.carried_plan import CarriedPlan
from bess.edge.serve.commitment import Commitment, Curves, Task
from bess.edge.serve.constraints import envelope, share
from bess.edge.serve.forecast import Forecast
from bess.edge.serve.measurement_validator import MeasurementValidator
from bess.edge.serve.persistent import Persistent
from bess.edge.serve.plan_tracker import PlanTracker, ahead, preferences
from bess.edge.serve.reasons import reasons, status
from bess.edge.serve.soc_limits import PowerCapability, SocLimits
from bess.edge.serve.valid_state import ValidState
from bess.errors import InputError
from bess.study.sections import ServiceSection
from bess.system import State, System


class Controller(Persistent):
    """One plant's controller; it is called from one thread at a time.

    Parameters
    ----------
    system
        The plant's parameters.
    policy
        Makes the plan; any policy of the closed loop.
    service
        Settings.
    plan_steps
        Steps that the policy looks ahead.
    background
        Make plans in a thread of its own. Without it every call is as good as it can be, repeats to the
        last bit, and may take as long as a plan takes: for simulations.

    Attributes
    ----------
    drives : bool
        Whether the set-points reach the plant; strings are then expected to follow them.
    able : PowerCapability
        What the strings could take and give in the last step.
    ahead_kw : ndarray, shape (plan_steps,)
        Demand that the last step foresaw, its own step of the plan first.

    Raises
    ------
    InputError
        For settings that do not fit the system.
    """

    kept = (
        "_last_s", "last_kw", "commitment", "_guard", "ageing", "calibration", "_forecast", "_following",
        "counters",
    )  # fmt: skip

    def __init__(
        self,
        system: System,
        policy: Policy,
        service: ServiceSection,
        plan_steps: int,
        *,
        background: bool = True,
    ) -> None:
        n = system.n_strings
        plan_s = system.control.step_min * 60.0
        self.system, self.service = system, service
        self.step_s = plan_s if service.control_step_s is None else service.control_step_s
        if self.step_s > plan_s:
            raise InputError(
                f"service.control_step_s = {self.step_s:g} s: must not exceed the plan's step, {plan_s:g} s"
            )
        self.soc_limits = SocLimits(system, service, self.step_s)
        self.plan = CarriedPlan(system, policy, plan_s, plan_steps, background=background)
        self._following = PlanTracker(self.plan, self.step_s)
        self._forecast = Forecast(self.step_s, plan_s, plan_steps)
        self.ageing = Ageing(system)
        self._guard = MeasurementValidator(system, service, self.step_s, self.ageing)
        self.commitment = Commitment(
            n,
            start_kwh=service.start_kwh,
            minimum_on_s=service.minimum_on_s,
            minimum_off_s=service.minimum_off_s,
        )
        self.counters = Counters(n)
        self.drives = True
        self.calibration = Calibration(system, service, self.soc_limits, background=background)
        self.last_kw: Array = np.zeros(n)
        self.trusted: ValidState | None = None
        self.able = PowerCapability(np.zeros(n), np.zeros(n))
        self.ahead_kw: Array = np.zeros(plan_steps)
        self._last_s: float | None = None

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return self.system.n_strings

    def step(
        self,
        measured: Measurements,
        demand_kw: float,
        now_s: float,
        *,
        forecast_kw: Sequence[float] | Array | None = None,
        wait_s: float = 0.0,
    ) -> Answer:
        """Decide for the control step that begins.

        Parameters
        ----------
        measured
            What the plant says.
        demand_kw
            Demand now, finite.
        now_s
            Time of a clock that never goes back; a multiple of the plan's step is where the plan has steps.
        forecast_kw : array_like, shape (n,), optional
            Mean demand of the present step of the plan and those after it; by default what it was at the same
            time of the day before.
        wait_s
            How long to wait for a plan that is due.
        """
        began = time.perf_counter()
        elapsed_s = self.step_s if self._last_s is None else max(0.0, now_s - self._last_s)
        self._last_s = now_s
        trusted = self._look_back(measured, elapsed_s)

        forecast = self._forecast(demand_kw, self.plan.slot(now_s), elapsed_s, forecast_kw)
        self.plan.update(now_s, trusted.state, forecast, trusted.limit_kw, wait_s=wait_s)

        able = self.soc_limits.able(trusted)
        day_kw = self._forecast.day(self.plan.slot(now_s), forecast_kw)
        self.calibration.update(now_s, trusted, day_kw, self.plan.step_s)
        # Strings out of service that still give power are part of what the plant gives.
        asked_kw = demand_kw - float(trusted.flowing_kw.sum())
        charge_kw = self.calibration.charge_kw(trusted, able, asked_kw, self.step_s / 3600.0)
        calibrating = (np.arange(self.n_strings) == self.calibration.string) & (charge_kw is not None)
        request = np.zeros(self.n_strings) if charge_kw is None else -charge_kw
        rest_kw = asked_kw - float(request.sum())
        discharge = rest_kw > 0.0 or (rest_kw == 0.0 and asked_kw >= 0.0)
        sharing = trusted.in_service & ~calibrating
        able_to_share = able.only(sharing)

        wanted = self._choose(trusted, able_to_share, sharing, abs(rest_kw), discharge, now_s, elapsed_s)
        limits = envelope(
            able_to_share.charge_kw,
            able_to_share.discharge_kw,
            np.where(sharing, self.last_kw, 0.0),
            None if self.service.ramp_kw_per_s is None else self.service.ramp_kw_per_s * self.step_s,
        )
        running = self.commitment.running & sharing
        request = request + share(rest_kw, wanted, running, limits, self.soc_limits.minimum_kw)

        unmet_kw = unmet(asked_kw, request)
        self.last_kw, self.trusted, self.able, self.ahead_kw = request, trusted, able, forecast
        self.counters.answers += 1
        self.counters.unmet_kwh += unmet_kw * self.step_s / 3600.0
        return Answer(
            request_kw=request,
            plan_kw=ahead(self.plan, request, forecast_kw, now_s, trusted.limit_kw),
            status=status(unmet_kw, demand_kw, self.plan.column(now_s) is not None, self.plan.error),
            gap=self.plan.gap(request, now_s),
            fallback=False,
            unmet_kw=unmet_kw,
            valid_for_s=self.step_s,
            solve_time_s=time.perf_counter() - began,
            running=self.commitment.running.copy(),
            in_service=trusted.in_service,
            flowing_kw=trusted.flowing_kw,
            reasons=reasons(self.system, trusted, able, request, self.commitment.running, self.calibration),
        )

    def fallback(self, measured: Measurements, demand_kw: float, why: str, n_steps: int = 1) -> Answer:
        """Share by the energy left, from the measurements alone; see :meth:`applied`.

        Safe to be called from another thread while :meth:`step` is under way.
        """
        began = time.perf_counter()
        flowing_kw = np.zeros(self.n_strings) if self.trusted is None else self.trusted.flowing_kw
        demand_kw = demand_kw - float(flowing_kw.sum())
        discharge = demand_kw >= 0.0
        known = measured.available & (measured.soc >= 0.0) & (measured.soc <= 1.0)
        room = self.soc_limits.room(np.where(known, measured.soc, 0.5), discharge)
        left_kwh = room * self.system.nominal_energy_kwh
        limit = measured.discharge_limit_kw if discharge else measured.charge_limit_kw
        most = np.minimum(np.minimum(limit, self.system.nominal_kw), left_kwh * 3600.0 / self.step_s)
        most = np.maximum(np.nan_to_num(np.where(known, most, 0.0)), 0.0)
        power = water_fill(abs(demand_kw), left_kwh, most)
        power[power < self.soc_limits.minimum_kw] = 0.0
        request = power if discharge else -power
        return Answer(
            request_kw=request,
            plan_kw=np.repeat(request[:, None], n_steps, axis=1),
            status=why,
            gap=None,
            fallback=True,
            unmet_kw=unmet(demand_kw, request),
            valid_for_s=self.step_s,
            solve_time_s=time.perf_counter() - began,
            running=power > 0.0,
            in_service=known,
            flowing_kw=flowing_kw,
            reasons=tuple(
                f"string {i} {'runs' if p else 'rests'}: shared by the energy left"
                for i, p in enumerate(power)
            ),
        )

    def applied(self, answer: Answer) -> None:
        """Take note that this answer went out in place of the last of :meth:`step`."""
        self.last_kw = answer.request_kw
        self.commitment.set_commitment(answer.running, np.ones(self.n_strings, dtype=bool))
        self.counters.fallbacks += 1

    def at_least_loss(self, demand_kw: float, soc: Array) -> Array:
        """Set-points [kW] of the least loss at these states of charge; nothing is remembered.

        Temperatures are those measured last. For callers who know no more than that; see :meth:`step`.
        """
        discharge = demand_kw >= 0.0
        last = self.system.initial_state() if self.trusted is None else self.trusted.state
        within = np.clip(soc, self.soc_limits.empty, self.soc_limits.full)
        state = State(within, last.temperature_c, last.soh_capacity, last.soh_resistance)
        able = self.soc_limits.able(ValidState.without_doubt(state, self.system.nominal_kw))
        most = able.towards(discharge)
        curves = Curves.of(self.system, state, discharge)
        task = Task(abs(demand_kw), most, most > 0.0, curves, np.zeros(self.n_strings))
        chosen = Commitment(self.n_strings, start_kwh=0.0)
        chosen.update(task, elapsed_s=0.0, step_s=self.plan.step_s)
        limits = envelope(able.charge_kw, able.discharge_kw, self.last_kw, None)
        wanted = task.best_shares(chosen.running)
        return share(demand_kw, wanted, chosen.running, limits, self.soc_limits.minimum_kw)

    def calibrate(self, string: int, target_soc: float = 1.0) -> None:
        """Begin to charge one string to full while the others carry the load.

        Raises
        ------
        InputError
            If there is no such string, no other one, or the target is outside its window.
        """
        self.calibration.begin(string, target_soc)

    def close(self) -> None:
        """End the thread that plans."""
        self.plan.close()

    def _look_back(self, measured: Measurements, elapsed_s: float) -> ValidState:
        """What may be trusted of the measurements, given what was asked; count what that moved and aged."""
        # Set-points held no longer than they were valid.
        held_s = min(elapsed_s, self.step_s)
        self.counters.carry(self.last_kw, held_s)
        # A plant that is only watched follows somebody else.
        asked_kw = self.last_kw if self.drives else np.nan_to_num(measured.power_kw)
        trusted = self._guard(measured, asked_kw, elapsed_s, drives=self.drives)
        self.ageing.gather(trusted.state, asked_kw, elapsed_s, held_s)
        return trusted

    def _choose(
        self,
        trusted: ValidState,
        able: PowerCapability,
        usable: Flags,
        demand_kw: float,
        discharge: bool,
        now_s: float,
        elapsed_s: float,
    ) -> Array:
        """Switch what is to run; return the magnitudes wanted of each string."""
        most = able.towards(discharge)
        most = np.where(most >= self.soc_limits.minimum_kw, most, 0.0)
        coming = self.plan.from_now(now_s)
        planned = None if coming is None else coming[:, 0]
        signed_kw = demand_kw if discharge else -demand_kw
        followed = self._following.shares(planned, signed_kw, most, elapsed_s)
        if followed is not None:
            self.commitment.advance_time(usable, demand_kw, elapsed_s)
            self.commitment.set_commitment(followed > 0.0, usable & (most > 0.0))
            return followed
        curves = Curves.of(self.system, trusted.worse(discharge), discharge)
        task = Task(demand_kw, most, usable, curves, preferences(planned, curves, discharge))
        self.commitment.update(task, elapsed_s=elapsed_s, step_s=self.step_s)
        return task.best_shares(self.commitment.running)
