"""The live controller: measurements and a demand in, set-points and their reasons out.

A policy updates its plan at the control step of the system, usually every 15 minutes. Each control step of a
second or more, :meth:`Controller.step`, goes through: measurements -> validated state
(:mod:`.measurement_validator`) -> a new plan if due (:mod:`.plan`) -> capability of the strings
(:mod:`.constraints`) -> a string in calibration (:mod:`.calibration`) -> inverters that run: those of the
plan while it fits, else by :mod:`.commitment` -> set-points that satisfy all constraints.

No step waits for a plan longer than permitted.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Final

import numpy as np

from bess.arrays import Array, Flags
from bess.checkpoints import Checkpointed
from bess.control.policies import Policy
from bess.control.policies.rule import water_fill
from bess.edge.plant_io import Measurements
from bess.edge.serve.ageing import Ageing
from bess.edge.serve.answer import Answer, Sharing, reasons, status, unmet
from bess.edge.serve.calibration import Calibration
from bess.edge.serve.commitment import Commitment, CommitmentProblem, Curves
from bess.edge.serve.constraints import PowerCapability, SocLimits, set_point_range, share
from bess.edge.serve.measurement_validator import MeasurementValidator, ValidState
from bess.edge.serve.plan import CarriedPlan, DemandForecast, preferences
from bess.errors import InputError
from bess.study.sections import Event, ServiceSection
from bess.system import System

PLAN_DEVIATION: Final = 0.1
"""Relative deviation from the demand of the plan up to which its shares are used."""
PLAN_DEVIATION_S: Final = 60.0
"""Time for which the demand must stay this near."""
MAX_OUTAGE_S: Final = 366 * 86_400.0
"""A longer time since the last step is due to a clock that was wrong then, as one that began in 1970."""


class Controller(Checkpointed):
    """The controller of one plant; called from one thread at a time.

    Any policy of the closed loop plans ``plan_steps`` ahead, in separate threads. Without ``background``, for
    simulations, a call waits for its plan and is reproducible to the last bit.

    Attributes
    ----------
    drives : bool
        Whether the set-points reach the plant; strings are then expected to follow them.
    watches : bool
        Whether set-points are never written; ramps then begin at the last ones, not at the plant's power.
    valid, able, ahead_kw
        Validated state, capability, and forecast (present step first) of the last step.
    answers, fallbacks, charged_kwh, discharged_kwh
        Totals since the state began: answers, and energy requested of each string ``>= 0``.
    """

    _carried = (
        "_last_s", "last_kw", "commitment", "_guard", "ageing", "calibration", "_forecast", "_near_s",
        "answers", "fallbacks", "charged_kwh", "discharged_kwh",
    )  # fmt: skip

    def __init__(
        self,
        system: System,
        policy: Policy,
        service: ServiceSection,
        plan_steps: int,
        *,
        events: tuple[Event, ...] = (),
        background: bool = True,
    ) -> None:
        n = self.n_strings = system.n_strings
        self.system, self.service = system, service
        # One thread for plans, one for calibrations.
        self._pool = ThreadPoolExecutor(2, "planning") if background else None
        self.plan = CarriedPlan(system, policy, plan_steps, self._pool, events)
        plan_s = self.plan.step_s
        self.step_s = plan_s if service.control_step_s is None else service.control_step_s
        self._ramp_kw = None if service.ramp_kw_per_s is None else service.ramp_kw_per_s * self.step_s
        if self.step_s > plan_s:
            raise InputError(
                f"service.control_step_s = {self.step_s:g} s: must not exceed the plan's step, {plan_s:g} s"
            )
        self.soc_limits = SocLimits(system, service, self.step_s)
        self._near_s = 0.0
        self._forecast = DemandForecast(self.step_s, plan_s, plan_steps)
        self.ageing = Ageing(system)
        self._guard = MeasurementValidator(system, service, self.step_s, self.ageing)
        self.commitment = Commitment(n, service)
        self.answers = self.fallbacks = 0
        self.charged_kwh: Array = np.zeros(n)
        self.discharged_kwh: Array = np.zeros(n)
        self.drives, self.watches = True, False
        self.calibration = Calibration(system, service, self.soc_limits, self._pool)
        self.last_kw: Array = np.zeros(n)
        self.valid: ValidState | None = None
        self.able = PowerCapability(np.zeros(n), np.zeros(n))
        self.ahead_kw: Array = np.zeros(plan_steps)
        self._last_s: float | None = None

    def step(
        self,
        measured: Measurements,
        demand_kw: float,
        now_s: float,
        *,
        forecast_kw: Sequence[float] | Array | None = None,
        wait_s: float = 0.0,
    ) -> Answer:
        """Decide for the control step that begins, in which the demand is ``demand_kw``.

        Parameters
        ----------
        now_s
            Time of a clock that never goes back; the plan's steps begin at its multiples.
        forecast_kw : array_like, shape (n,), optional
            Mean demand of the present step of the plan and the next ones; by default that of the day before.
        wait_s
            Maximum waiting time for a plan that is due.
        """
        began = time.perf_counter()
        elapsed_s = self.step_s if self._last_s is None else max(0.0, now_s - self._last_s)
        if elapsed_s > MAX_OUTAGE_S:
            elapsed_s = self.step_s
        self._last_s = now_s
        # Set-points that did not arrive, or have expired, are not those of the plant.
        held = self.drives and elapsed_s <= self.step_s + self.service.watchdog_s
        valid = self._validate(measured, self._set_kw(measured, held), elapsed_s, held)
        self.valid = valid  # also for a fallback, if this step fails
        slot = self.plan.slot(now_s)
        forecast = self._forecast(demand_kw, slot, elapsed_s, forecast_kw)
        self.plan.update(now_s, valid.state, forecast, valid.limit_kw, wait_s=wait_s)

        able = self.soc_limits.able(valid)
        self.calibration.update(now_s, valid, self._forecast.day(slot, forecast_kw))
        # Strings out of service that still give power contribute to the demand.
        asked_kw = demand_kw - float(valid.flowing_kw.sum())
        request, sharing = self.calibration.request(valid, able, asked_kw, self.step_s / 3600.0)
        sharing &= valid.in_service
        rest_kw = asked_kw - float(request.sum())
        discharge = rest_kw > 0.0 or (rest_kw == 0.0 and asked_kw >= 0.0)
        able_to_share = able.only(sharing)

        wanted = self._choose(valid, able_to_share, sharing, rest_kw, discharge, now_s, elapsed_s)
        before_kw = np.where(sharing, self._set_kw(measured, held or self.watches), 0.0)
        limits = set_point_range(able_to_share, before_kw, self._ramp_kw)
        running = self.commitment.running & sharing
        request = request + share(rest_kw, wanted, running, limits, self.soc_limits.minimum_kw)

        shared = Sharing(rest_kw, request, able, limits, self.soc_limits.minimum_kw)
        unmet_kw = unmet(asked_kw, request)
        self.last_kw, self.able, self.ahead_kw = request, able, forecast
        self.answers += 1
        return Answer(
            request_kw=request,
            plan_kw=self.plan.ahead(request, forecast_kw, now_s, valid.limit_kw),
            status=status(unmet_kw, asked_kw, self.plan.from_now(now_s) is not None, self.plan.making.error),
            gap=self.plan.gap(request, now_s),
            fallback=False,
            unmet_kw=unmet_kw,
            valid_for_s=self.step_s,
            solve_time_s=time.perf_counter() - began,
            running=self.commitment.running.copy(),
            in_service=valid.in_service,
            flowing_kw=valid.flowing_kw,
            reasons=reasons(self.system, valid, shared, self.commitment.running, self.calibration),
        )

    def fallback(self, measured: Measurements, demand_kw: float, why: str, n_steps: int = 1) -> Answer:
        """Share the demand by stored energy or headroom, from the measurements alone; see :meth:`applied`.

        May be called from another thread during :meth:`step`.
        """
        began = time.perf_counter()
        flowing_kw, known = np.zeros(self.n_strings), measured.available
        if self.valid is not None:
            flowing_kw, known = self.valid.flowing_kw, known & self.valid.in_service
        demand_kw = demand_kw - float(flowing_kw.sum())
        discharge = demand_kw >= 0.0
        known = known & (measured.soc >= 0.0) & (measured.soc <= 1.0)
        soc = np.where(known, measured.soc, 0.5)
        energy_kwh = self.system.nominal_energy_kwh * self.ageing.soh_capacity

        def most_kw(limit_kw: Array, discharge: bool) -> Array:
            left_kw = self.soc_limits.left_kwh(soc, energy_kwh, discharge) * 3600.0 / self.step_s
            most = np.minimum(np.minimum(limit_kw, self.system.nominal_kw), left_kw)
            return np.where(known, np.maximum(np.nan_to_num(most), 0.0), 0.0)

        able = PowerCapability(
            most_kw(measured.charge_limit_kw, False), most_kw(measured.discharge_limit_kw, True)
        )
        left_kwh = self.soc_limits.left_kwh(soc, energy_kwh, discharge)
        wanted = water_fill(abs(demand_kw), left_kwh, able.towards(discharge))
        before_kw = np.where(known, self._set_kw(measured, self.drives or self.watches), 0.0)
        limits = set_point_range(able, before_kw, self._ramp_kw)
        request = share(demand_kw, wanted, wanted > 0.0, limits, self.soc_limits.minimum_kw)
        self.last_kw = request
        running = request != 0.0
        verbs = ("runs" if on else "rests" for on in running)
        return Answer(
            request_kw=request,
            plan_kw=np.repeat(request[:, None], n_steps, axis=1),
            status=why,
            gap=None,
            fallback=True,
            unmet_kw=unmet(demand_kw, request),
            valid_for_s=self.step_s,
            solve_time_s=time.perf_counter() - began,
            running=running,
            in_service=known,
            flowing_kw=flowing_kw,
            reasons=tuple(f"string {i} {verb}: shared by stored energy" for i, verb in enumerate(verbs)),
        )

    def applied(self, fallback: Answer) -> None:
        """Record that a fallback replaced the last answer of :meth:`step`."""
        self.last_kw = fallback.request_kw
        self.commitment.set_commitment(fallback.running, np.ones(self.n_strings, dtype=bool))
        self.fallbacks += 1

    def at_least_loss(self, demand_kw: float, soc: Array) -> Array:
        """Set-points [kW] at minimum loss for these SOC and the last measured temperatures; stateless."""
        discharge = demand_kw >= 0.0
        last = self.system.initial_state() if self.valid is None else self.valid.state
        state = replace(last, soc=np.clip(soc, self.soc_limits.empty, self.soc_limits.full))
        able = self.soc_limits.able(ValidState.without_doubt(state, self.system))
        most = able.towards(discharge)
        curves = Curves.of(self.system, state, discharge)
        problem = CommitmentProblem(abs(demand_kw), most, most > 0.0, curves, np.zeros(self.n_strings))
        chosen = Commitment(self.n_strings, ServiceSection(start_kwh=0.0))
        chosen.update(problem, elapsed_s=0.0, step_s=self.plan.step_s)
        limits = set_point_range(able, self.last_kw, None)
        wanted = problem.best_shares(chosen.running)
        return share(demand_kw, wanted, chosen.running, limits, self.soc_limits.minimum_kw)

    def close(self) -> None:
        """End the threads of plan and calibration."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def _set_kw(self, measured: Measurements, held: bool) -> Array:
        """Set-points of the plant: the last ones if it holds them, otherwise its power."""
        most_kw = self.system.nominal_kw
        return self.last_kw if held else np.clip(np.nan_to_num(measured.power_kw), -most_kw, most_kw)

    def _validate(self, measured: Measurements, asked_kw: Array, elapsed_s: float, held: bool) -> ValidState:
        """Validate the measurements; count energy and ageing since the last step."""
        held_s = min(elapsed_s, self.step_s)
        held_h = held_s / 3600.0
        self.charged_kwh = self.charged_kwh + np.maximum(-self.last_kw, 0.0) * held_h
        self.discharged_kwh = self.discharged_kwh + np.maximum(self.last_kw, 0.0) * held_h
        valid = self._guard(measured, asked_kw, elapsed_s, drives=held)
        self.ageing.gather(valid.state, asked_kw, elapsed_s, held_s)
        return valid

    def _choose(
        self,
        valid: ValidState,
        able: PowerCapability,
        usable: Flags,
        demand_kw: float,
        discharge: bool,
        now_s: float,
        elapsed_s: float,
    ) -> Array:
        """Switch inverters for a signed demand; return the wanted magnitude of each string."""
        most = able.towards(discharge)
        most = np.where(most >= self.soc_limits.minimum_kw, most, 0.0)
        coming = self.plan.from_now(now_s)
        planned = None if coming is None else coming[:, 0]
        followed = self._planned_shares(planned, demand_kw, most, elapsed_s)
        if followed is not None:
            self.commitment.advance_time(usable, abs(demand_kw), elapsed_s)
            self.commitment.set_commitment(followed > 0.0, usable & (most > 0.0))
            return followed
        curves = Curves.of(self.system, valid.worse(discharge), discharge)
        price = preferences(planned, curves, discharge)
        problem = CommitmentProblem(abs(demand_kw), most, usable, curves, price)
        self.commitment.update(problem, elapsed_s=elapsed_s, step_s=self.step_s)
        return problem.best_shares(self.commitment.running)

    def _planned_shares(
        self, planned_kw: Array | None, demand_kw: float, max_kw: Array, elapsed_s: float
    ) -> Array | None:
        """Magnitudes in the proportions of the plan; None if the plan is not to be followed now.

        A demand that only crosses that of the plan must not switch inverters, so it has to stay near for a
        while. ``planned_kw`` are the plan's present set-points, ``demand_kw`` is signed, and ``max_kw`` is
        the capability of each string in its direction.
        """
        plan_kw = 0.0 if planned_kw is None else float(planned_kw.sum())
        is_near = abs(demand_kw - plan_kw) <= PLAN_DEVIATION * abs(plan_kw)
        self._near_s = self._near_s + elapsed_s if is_near else 0.0
        if (
            planned_kw is None
            or not is_near
            or self._near_s + self.step_s < min(PLAN_DEVIATION_S, self.plan.step_s)
        ):
            return None
        wanted = np.abs(planned_kw) * (abs(demand_kw) / abs(plan_kw) if plan_kw else 0.0)
        return wanted if (wanted <= max_kw * (1.0 + 1e-9)).all() else None
