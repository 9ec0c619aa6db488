"""The service: a controller with its queue, its state on disk, its history and its metrics."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, Final

import numpy as np

from bess.control.policies import build_policy
from bess.edge.plant_io import Measurements
from bess.edge.serve import LOG
from bess.edge.serve.answer import Answer, ControlRequest, Demand
from bess.edge.serve.controller import Controller
from bess.edge.serve.monitoring import History, Metrics
from bess.edge.serve.state_store import StateStore
from bess.study import Study
from bess.study.events import check_events
from bess.study.plant_choice import build_system, policy_settings

PLAN_SHARE: Final = 0.5
"""Share of the permitted answer time for which an answer may wait for a plan."""
FORESEEN_S: Final = 3600.0
"""Lead time of the forecast that the live page compares with the demand."""
_UNMET_KW: Final = 1e-3
"""Demands below one watt count as zero."""


def build_controller(study: Study, *, background: bool = True) -> tuple[Controller, list[str]]:
    """Return the controller of a study, and notes on deviations from the study."""
    notes = []
    if study.policy.objectives.kind == "money":
        # Prices belong to the demand, which comes from outside here.
        study = study.with_values({"policy.objectives.kind": "energy"})
        notes.append("plans minimise undelivered energy and losses, not cost: a service receives no prices")
    system = build_system(study.system, study.run, study.wear)
    check_events(study.event, system)
    settings = policy_settings(study, system)
    policy = build_policy(study.policy.name, system, settings)
    announced = tuple(event for event in study.event if event.announced)
    if len(announced) < len(study.event):
        notes.append("[[event]] without announced = true is not used: the plant reports outages and limits")
    controller = Controller(
        system, policy, study.service, settings.horizon_steps, events=announced, background=background
    )
    return controller, notes


class Service:
    """The controller behind the HTTP routes and the control loop; one thread does all work on it.

    ``folder`` holds the state.
    """

    def __init__(self, study: Study, folder: Path) -> None:
        self.name = study.name
        self.controller, self.notes = build_controller(study)
        offset_s = time.time() - time.monotonic()
        # Seconds since 1970 of a clock that never goes back.
        self.clock: Callable[[], float] = lambda: time.monotonic() + offset_s
        for note in self.notes:
            LOG.info(note)
        self.memory = StateStore(folder, self.controller.system)
        self.notes.append(self.memory.load(self.controller, self.clock()))
        self.history = History()
        self.metrics = Metrics()
        self.last: tuple[float, ControlRequest, Answer] | None = None
        self._foreseen_kw: dict[int, float] = {}
        self._worker = ThreadPoolExecutor(1, "controller")

    async def split(self, measured: Measurements, demand: Demand) -> Answer:
        """Return an answer within the permitted time: the controller's, or the fallback."""
        request = ControlRequest(measured, demand)
        work = self._worker.submit(self._decide, request)
        await asyncio.wait([asyncio.wrap_future(work)], timeout=self.controller.service.answer_within_s)
        return self._outcome(request, work)

    def answer(self, measured: Measurements, demand: Demand) -> Answer:
        """As :meth:`split`, for a thread that may wait."""
        request = ControlRequest(measured, demand)
        work = self._worker.submit(self._decide, request)
        wait([work], timeout=self.controller.service.answer_within_s)
        return self._outcome(request, work)

    async def call(self, function: Any, *arguments: Any) -> Any:
        """Run a function in the thread of the controller."""
        return await asyncio.wrap_future(self._worker.submit(function, *arguments))

    def calibrate(self, string: int, target_soc: float) -> None:
        """Begin a calibration."""
        self.controller.calibration.begin(string, target_soc)
        self.memory.save(self.controller)

    def end_calibration(self) -> None:
        """End the present calibration."""
        self.controller.calibration.string = None
        self.memory.save(self.controller)

    def health(self) -> dict[str, Any]:
        """Public document of ``/v1/health``."""
        unmet_kw, flowing_kw, out_of_service = 0.0, 0.0, []
        if self.last is not None:
            answer = self.last[2]
            unmet_kw, flowing_kw = answer.unmet_kw, float(answer.flowing_kw.sum())
            out_of_service = np.flatnonzero(~answer.in_service).tolist()
        degraded = unmet_kw > _UNMET_KW or bool(out_of_service)
        return {
            "status": "impaired" if self.memory.error else "degraded" if degraded else "ok",
            "study": self.name,
            "n_strings": self.controller.n_strings,
            "answers": self.controller.answers,
            "last_answer_s": None if self.last is None else round(self.clock() - self.last[0], 3),
            "planned": self.controller.plan.current is not None,
            "unmet_kw": unmet_kw,
            "out_of_service": out_of_service,
            "out_of_control_kw": flowing_kw,
        }

    def close(self) -> None:
        """End the threads; the state is already on disk."""
        self._worker.shutdown(wait=True)
        self.controller.close()
        self.memory.close()

    def _decide(self, request: ControlRequest) -> Answer | str:
        """Return the controller's answer, recorded; or the reason why there is none."""
        now_s = self.clock()
        try:
            answer = self.controller.step(
                request.measured,
                request.demand.now_kw,
                now_s,
                forecast_kw=request.demand.forecast_kw,
                wait_s=PLAN_SHARE * self.controller.service.answer_within_s,
            )
            self._record(now_s, request, answer)
        except BaseException as error:  # a panic of the core is not an Exception
            LOG.exception("the controller failed")
            return f"The controller failed ({type(error).__name__}: {error})"
        return answer

    def _outcome(self, request: ControlRequest, work: Future[Answer | str]) -> Answer:
        """The controller's answer if it is ready, else the fallback."""
        if work.done():
            outcome = work.result()
        else:
            work.cancel()
            outcome = f"The controller had no answer within {self.controller.service.answer_within_s:g} s"
        if isinstance(outcome, str):
            status = f"{outcome}; shared by stored energy."
            n_steps = len(request.demand.forecast_kw or [0.0])
            outcome = self.controller.fallback(request.measured, request.demand.now_kw, status, n_steps)
            self.metrics.fallbacks.inc()
            LOG.warning(status)
            self._worker.submit(self._applied, outcome, request)
        self.metrics.answer_time.observe(time.monotonic() - request.received_s)
        return outcome

    def _applied(self, fallback: Answer, request: ControlRequest) -> None:
        self.controller.applied(fallback)
        self._record(self.clock(), request, fallback)

    def _record(self, now_s: float, request: ControlRequest, answer: Answer) -> None:
        """Save the state; record the answer in history, metrics and log."""
        controller = self.controller
        self.memory.save(controller)
        self.metrics.state_errors.set(bool(self.memory.error))
        if controller.valid is not None:
            state = controller.valid.state
            plant = {
                "time_s": now_s,
                "demand_kw": request.demand.now_kw,
                "request_kw": float(answer.request_kw.sum()),
                "measured_kw": request.measured_kw,
                "foreseen_kw": self._foreseen(now_s),
                "starts": float(controller.commitment.starts.sum()),
                "hottest_c": float(state.temperature_c.max()),
            }
            self.history.add(plant, state.soc, answer.request_kw)
        self.last = (now_s, request, answer)
        fields = {
            "demand_kw": request.demand.now_kw,
            "request_kw": answer.request_kw.tolist(),
            "unmet_kw": answer.unmet_kw,
            "fallback": answer.fallback,
            "solve_time_s": round(answer.solve_time_s, 6),
            "out_of_service": [answer.reasons[i] for i in np.flatnonzero(~answer.in_service)],
        }
        LOG.info("answer", extra={"fields": fields})

    def _foreseen(self, now_s: float) -> float:
        """Forecast of an hour ago for this step of the plan [kW]; NaN without one."""
        plan, ahead_kw = self.controller.plan, self.controller.ahead_kw
        slot, hour = plan.slot(now_s), round(FORESEEN_S / plan.step_s)
        if hour < ahead_kw.size:
            self._foreseen_kw[slot + hour] = float(ahead_kw[hour])
        self._foreseen_kw = {at: kw for at, kw in self._foreseen_kw.items() if at >= slot}
        return self._foreseen_kw.get(slot, np.nan)
