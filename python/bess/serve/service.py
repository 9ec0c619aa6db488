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

from bess.plants import Measurements
from bess.policies import build_policy
from bess.serve.answer import Answer
from bess.serve.clock import Clock
from bess.serve.controller import Controller
from bess.serve.history import History
from bess.serve.memory import Memory
from bess.serve.metrics import Metrics
from bess.study import Study
from bess.study.plant_choice import build_system
from bess.study.policy_settings import policy_settings

LOG: Final = logging.getLogger("bess.serve")
PLAN_SHARE: Final = 0.5
"""Part of the time in which an answer is due that it may wait for a plan."""
_UNMET_KW: Final = 1e-3
"""No plant is asked for less than a watt."""


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
class Question:
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
        self.memory = Memory(folder, self.controller.system)
        self.notes.append(self.memory.load(self.controller, self.clock()))
        self.history = History()
        self.metrics = Metrics(self.controller.n_strings)
        self.last: tuple[float, float, Answer] | None = None
        self._worker = ThreadPoolExecutor(1, "controller")

    async def split(
        self, measured: Measurements, demand_kw: float, forecast_kw: list[float] | None = None
    ) -> Answer:
        """Return an answer in the time that is allowed: the controller's, or the shares by energy."""
        question = Question(measured, demand_kw, forecast_kw)
        work = self._worker.submit(self._decide, question)
        await asyncio.wait([asyncio.wrap_future(work)], timeout=self.controller.service.answer_within_s)
        return self._outcome(question, work)

    def answer(
        self, measured: Measurements, demand_kw: float, forecast_kw: list[float] | None = None
    ) -> Answer:
        """As :meth:`split`, for a thread that may wait."""
        question = Question(measured, demand_kw, forecast_kw)
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
        self.controller.calibration = None
        self.memory.save(self.controller)

    def live(self) -> dict[str, Any]:
        """What the page shows."""
        controller = self.controller
        document: dict[str, Any] = {
            "study": self.name,
            "time_s": self.clock(),
            "n_strings": controller.n_strings,
            "nominal_kw": controller.system.nominal_kw.tolist(),
            "control_step_s": controller.step_s,
            "starts": controller.commitment.starts.tolist(),
            "soh_capacity": controller.ageing.soh_capacity.tolist(),
            "answers": controller.counters.answers,
            "fallbacks": controller.counters.fallbacks,
            "calibrating": None if controller.calibration is None else controller.calibration.string,
            "notes": [note for note in (*self.notes, self.memory.error) if note],
            "history": self.history.points(),
            "last": None,
        }
        if self.last is not None:
            at_s, demand_kw, answer = self.last
            trusted = controller.trusted
            document["last"] = {
                "time_s": at_s,
                "demand_kw": demand_kw,
                **answer.document(),
                "soc": None if trusted is None else trusted.state.soc.tolist(),
                "temperature_c": None if trusted is None else trusted.state.temperature_c.tolist(),
            }
        return document

    def metrics_text(self) -> bytes:
        """What Prometheus is told."""
        at_s, demand_kw, answer = self.last or (0.0, 0.0, None)
        return self.metrics.text(demand_kw, answer, self.controller, self.controller.plan.slot(at_s))

    def health(self) -> dict[str, Any]:
        """Whether all is well, in a few words that are no secret."""
        unmet_kw, out_of_service = 0.0, []
        if self.last is not None:
            answer = self.last[2]
            unmet_kw, out_of_service = answer.unmet_kw, np.flatnonzero(~answer.in_service).tolist()
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
        }

    def close(self) -> None:
        """End the threads; the state is on the disk already."""
        self._worker.shutdown(wait=True)
        self.controller.close()
        self.memory.close()

    def _decide(self, question: Question) -> Answer | str:
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
            self._take(now_s, question.demand_kw, answer)
        except Exception as error:
            LOG.exception("the controller failed")
            return f"The controller failed ({type(error).__name__}: {error})"
        return answer

    def _outcome(self, question: Question, work: Future[Answer | str]) -> Answer:
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

    def _fallback(self, question: Question, status: str) -> Answer:
        n_steps = len(question.forecast_kw or [0.0])
        answer = self.controller.fallback(question.measured, question.demand_kw, status, n_steps)
        self.metrics.fallbacks.inc()
        LOG.warning(status)
        self._worker.submit(self._applied, answer, question.demand_kw)
        return answer

    def _applied(self, answer: Answer, demand_kw: float) -> None:
        self.controller.applied(answer)
        self._take(self.clock(), demand_kw, answer)

    def _take(self, now_s: float, demand_kw: float, answer: Answer) -> None:
        controller = self.controller
        self.memory.save(controller)
        self.metrics.state_errors.set(bool(self.memory.error))
        if controller.trusted is not None:
            state = controller.trusted.state
            self.history.add(now_s, demand_kw, answer, state.soc, state.temperature_c)
        self.last = (now_s, demand_kw, answer)
        if LOG.isEnabledFor(logging.INFO):
            LOG.info(
                "answer",
                extra={
                    "fields": {
                        "demand_kw": demand_kw,
                        "request_kw": answer.request_kw.tolist(),
                        "unmet_kw": answer.unmet_kw,
                        "fallback": answer.fallback,
                        "solve_time_s": round(answer.solve_time_s, 6),
                    }
                },
            )
