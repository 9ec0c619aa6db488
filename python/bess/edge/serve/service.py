"""One controller and all that belongs to it: memory, history, metrics, and the queue in front of it."""

from __future__ import annotations

import asyncio
import logging
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from bess.control.policies import build_policy
from bess.edge.plant_io import Measurements
from bess.edge.serve.answer import Answer
from bess.edge.serve.clock import Clock
from bess.edge.serve.controller import Controller
from bess.edge.serve.history import History
from bess.edge.serve.metrics import Metrics
from bess.edge.serve.state_store import StateStore
from bess.study import Study
from bess.study.plant_choice import build_system
from bess.study.policy_settings import policy_settings

LOG: Final = logging.getLogger("bess.serve")
PLAN_SHARE: Final = 0.5
"""Part of the time in which an answer is due that it may wait for a plan."""
FORESEEN_S: Final = 3600.0
"""How long before a demand came the page shows it as it was foreseen."""
_UNMET_KW: Final = 1e-3
"""Demands below one watt count as zero."""


def build_controller(study: Study, *, background: bool = True) -> tuple[Controller, list[str]]:
    """Return the controller that a study describes, and what was done otherwise than it says.

    Raises
    ------
    InputError
        From the study, its system, or a policy that does not fit.
    """
    notes = []
    if study.policy.objectives.kind == "money":
        # Prices belong to the demand, which comes from outside here.
        study = study.with_values({"policy.objectives.kind": "energy"})
        notes.append("plans count kWh lost, not EUR: a service is given a demand, no prices")
    system = build_system(study.system, study.run, study.wear)
    settings = policy_settings(study, system)
    policy = build_policy(study.policy.name, system, settings)
    steps = settings.horizon_steps
    return Controller(system, policy, study.service, steps, background=background), notes


@dataclass(frozen=True)
class ControlRequest:
    """What the controller is asked, and when [s of the monotonic clock]."""

    measured: Measurements
    demand_kw: float
    forecast_kw: list[float] | None
    asked_s: float = field(default_factory=time.monotonic)


class Service:
    """What stands behind the HTTP routes and the cycle of a driven plant.

    All work on the controller is done in one thread, one call after the other.

    Parameters
    ----------
    study
        Which plant, policy and settings.
    folder
        For the state.
    """

    def __init__(self, study: Study, folder: Path) -> None:
        self.name = study.name
        self.controller, self.notes = build_controller(study)
        self.clock = Clock()
        self.memory = StateStore(folder, self.controller.system)
        self.notes.append(self.memory.load(self.controller, self.clock()))
        self.history = History()
        self.metrics = Metrics(self.controller.n_strings)
        self.last: tuple[float, float, Answer] | None = None
        self.told_ahead, self.measured_kw = False, np.nan
        self._foreseen_kw: dict[int, float] = {}
        self._worker = ThreadPoolExecutor(1, "controller")

    async def split(
        self, measured: Measurements, demand_kw: float, forecast_kw: list[float] | None = None
    ) -> Answer:
        """Return an answer in the time that is allowed: the controller's, or the shares by energy."""
        question = ControlRequest(measured, demand_kw, forecast_kw)
        work = self._worker.submit(self._decide, question)
        await asyncio.wait([asyncio.wrap_future(work)], timeout=self.controller.service.answer_within_s)
        return self._outcome(question, work)

    def answer(
        self, measured: Measurements, demand_kw: float, forecast_kw: list[float] | None = None
    ) -> Answer:
        """As :meth:`split`, for a thread that may wait."""
        question = ControlRequest(measured, demand_kw, forecast_kw)
        work = self._worker.submit(self._decide, question)
        wait([work], timeout=self.controller.service.answer_within_s)
        return self._outcome(question, work)

    async def call(self, function: Any, *arguments: Any) -> Any:
        """Run something in the thread of the controller."""
        return await asyncio.wrap_future(self._worker.submit(function, *arguments))

    def calibrate(self, string: int, target_soc: float) -> None:
        """Begin a calibration."""
        self.controller.calibrate(string, target_soc)
        self.memory.save(self.controller)

    def end_calibration(self) -> None:
        """End one before it is done."""
        self.controller.calibration.string = None
        self.memory.save(self.controller)

    def metrics_text(self) -> bytes:
        """Prometheus metrics."""
        at_s, demand_kw, answer = self.last or (0.0, 0.0, None)
        return self.metrics.text(demand_kw, answer, self.controller, self.controller.plan.slot(at_s))

    def health(self) -> dict[str, Any]:
        """Whether all is well, in a few words that are no secret."""
        unmet_kw, flowing_kw, out_of_service = 0.0, 0.0, []
        if self.last is not None:
            answer = self.last[2]
            unmet_kw, flowing_kw = answer.unmet_kw, float(answer.flowing_kw.sum())
            out_of_service = np.flatnonzero(~answer.in_service).tolist()
        lacks = unmet_kw > _UNMET_KW or bool(out_of_service)
        return {
            "status": "impaired" if self.memory.error else "degraded" if lacks else "ok",
            "study": self.name,
            "n_strings": self.controller.n_strings,
            "answers": self.controller.counters.answers,
            "last_answer_s": None if self.last is None else round(self.clock() - self.last[0], 3),
            "planned": self.controller.plan.current is not None,
            "unmet_kw": unmet_kw,
            "out_of_service": out_of_service,
            "out_of_control_kw": flowing_kw,
        }

    def close(self) -> None:
        """End the threads; the state is on the disk already."""
        self._worker.shutdown(wait=True)
        self.controller.close()
        self.memory.close()

    def _decide(self, question: ControlRequest) -> Answer | str:
        """Decide, and see to it that it is not forgotten; or say why there is no answer."""
        now_s = self.clock()
        try:
            answer = self.controller.step(
                question.measured,
                question.demand_kw,
                now_s,
                forecast_kw=question.forecast_kw,
                wait_s=PLAN_SHARE * self.controller.service.answer_within_s,
            )
            self._take(now_s, question, answer)
        except Exception as error:
            LOG.exception("the controller failed")
            return f"The controller failed ({type(error).__name__}: {error})"
        return answer

    def _outcome(self, question: ControlRequest, work: Future[Answer | str]) -> Answer:
        """What the controller has answered by now, else the fallback."""
        if work.done():
            outcome = work.result()
        else:
            work.cancel()
            outcome = f"The controller had no answer within {self.controller.service.answer_within_s:g} s"
        if isinstance(outcome, str):
            outcome = self._fallback(question, f"{outcome}; shared by the energy left.")
        self.metrics.answer_time.observe(time.monotonic() - question.asked_s)
        return outcome

    def _fallback(self, question: ControlRequest, status: str) -> Answer:
        n_steps = len(question.forecast_kw or [0.0])
        answer = self.controller.fallback(question.measured, question.demand_kw, status, n_steps)
        self.metrics.fallbacks.inc()
        LOG.warning(status)
        self._worker.submit(self._applied, answer, question)
        return answer

    def _applied(self, answer: Answer, question: ControlRequest) -> None:
        self.controller.applied(answer)
        self._take(self.clock(), question, answer)

    def _take(self, now_s: float, question: ControlRequest, answer: Answer) -> None:
        controller = self.controller
        self.memory.save(controller)
        self.metrics.state_errors.set(bool(self.memory.error))
        self.measured_kw = float(question.measured.power_kw.sum())
        if controller.trusted is not None:
            state = controller.trusted.state
            plant = {
                "time_s": now_s,
                "demand_kw": question.demand_kw,
                "request_kw": float(answer.request_kw.sum()),
                "measured_kw": self.measured_kw,
                "foreseen_kw": self._foreseen(now_s),
                "starts": float(controller.commitment.starts.sum()),
                "hottest_c": float(state.temperature_c.max()),
            }
            self.history.add(plant, state.soc, answer.request_kw)
        self.told_ahead = question.forecast_kw is not None
        self.last = (now_s, question.demand_kw, answer)
        if LOG.isEnabledFor(logging.INFO):
            LOG.info(
                "answer",
                extra={
                    "fields": {
                        "demand_kw": question.demand_kw,
                        "request_kw": answer.request_kw.tolist(),
                        "unmet_kw": answer.unmet_kw,
                        "fallback": answer.fallback,
                        "solve_time_s": round(answer.solve_time_s, 6),
                    }
                },
            )

    def _foreseen(self, now_s: float) -> float:
        """Demand of this step of the plan as it was foreseen an hour ago; NaN where nobody asked then."""
        plan, ahead_kw = self.controller.plan, self.controller.ahead_kw
        slot, hour = plan.slot(now_s), round(FORESEEN_S / plan.step_s)
        if hour < ahead_kw.size:
            self._foreseen_kw[slot + hour] = float(ahead_kw[hour])
        self._foreseen_kw = {at: kw for at, kw in self._foreseen_kw.items() if at >= slot}
        return self._foreseen_kw.get(slot, np.nan)
