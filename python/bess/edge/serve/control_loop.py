"""Control loop of a plant, in control or in shadow mode: read, decide, write, in every period.

Without certain data nothing is written, so that the watchdog of the plant clears the last set-point; zero is
written only if it is the demand.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from bess.arrays import Array
from bess.edge.plant_io import LinkError, Measurements, PlantLink
from bess.edge.plant_io.journal import Journal
from bess.edge.serve import LOG
from bess.edge.serve.answer import Answer, Demand
from bess.edge.serve.service import Service
from bess.errors import InputError
from bess.simulation.inputs import prepare
from bess.study import Study
from bess.study.demands import ProfileDemand
from bess.study.demands.profile import ProfileSource

STEP_S: Final = 10.0
"""Control step of a plant that the service controls, unless the settings state another."""
NO_DEMAND: Final = "there is no demand: post one to /v1/demand"
_QUANTITY: Final = re.compile(r"-?[\d.]+ (s|kW|%|°C|readings)(?!\w)")


class Demands:
    """The last posted demand while it is valid; otherwise none, or the study's profile.

    With ``service.follow_profile`` the profile applies within its times, and at all times with
    ``demand.repeat``. No demand is not a demand of zero: the plant is released.
    """

    def __init__(self, study: Study, plan_s: float) -> None:
        self._plan_s = plan_s
        self._posted: tuple[float | list[float], float, float, str] | None = None
        self._profile: Array | None = None
        if not study.service.follow_profile:
            return
        if not isinstance(study.demand, ProfileDemand):
            raise InputError(
                f"{study.name}: service.follow_profile = true, and [demand] is of kind "
                f'"{study.demand.kind}"; give a demand of kind "profile", or leave the key out'
            )
        inputs = prepare(study.with_values({"demand.forecast": "perfect"}))
        assert isinstance(inputs.demand, ProfileSource)
        self._profile = inputs.demand.forecast.ahead(0, inputs.grid.n_steps)
        self._start_s, self._step_s = inputs.grid.start_s, inputs.grid.step_s
        self._repeats = study.demand.repeat

    def post(self, demand_kw: float | list[float], valid_for_s: float, now_s: float, by: str = "") -> None:
        """Accept a demand, or a forecast that begins now, from a client's address."""
        self._posted = (demand_kw, now_s, now_s + valid_for_s, by)

    def at(self, now_s: float, n_steps: int) -> Demand | None:
        """The demand at a time with its forecast of up to ``n_steps``; None if there is none."""
        posted = self._posted
        if posted is not None and now_s < posted[2]:
            demand_kw, began_s, until_s, by = posted
            gone = int(now_s // self._plan_s) - int(began_s // self._plan_s)
            left = demand_kw[gone:] if isinstance(demand_kw, list) else demand_kw
            if left != []:
                source = f"posted{by and f' by {by}'}, valid for another {until_s - now_s:.0f} s"
                return Demand.of(left, source)
        if self._profile is None:
            return None
        first = int((now_s - self._start_s) // self._step_s)
        if self._repeats:
            ahead = self._profile[(first + np.arange(n_steps)) % self._profile.size]
        elif 0 <= first < self._profile.size:
            ahead = self._profile[first : first + n_steps]
        else:
            return None
        return Demand.of(ahead.tolist(), "the profile of the study")


class ControlLoop:
    """Controls a plant with the controller of a service.

    ``link`` is used only in the thread of :meth:`run`; ``address`` names the plant in messages. In ``shadow``
    mode set-points are computed and not written.
    """

    def __init__(
        self,
        service: Service,
        link: PlantLink,
        demands: Demands,
        journal: Journal,
        *,
        address: str = "",
        shadow: bool = False,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._service, self._link, self.demands, self._journal = service, link, demands, journal
        self.address, self._shadow, self._monotonic = address, shadow, monotonic
        self._stop = threading.Event()
        self._written: np.ndarray | None = None
        self._written_at_s = -np.inf
        self._holds = self._gives_way = False
        self._completed_s = monotonic()
        self.trouble = "the plant has not been read yet"
        self.journal_trouble = ""
        service.controller.drives, service.controller.watches = False, shadow
        service.metrics.cycle_age.set_function(lambda: self.age_s)
        service.metrics.cycle_period.set(self.period_s)

    @property
    def period_s(self) -> float:
        """Control step [s]."""
        return self._service.controller.step_s

    @property
    def age_s(self) -> float:
        """Time since the end of the last cycle, successful or not [s]."""
        return self._monotonic() - self._completed_s

    def active_demand(self) -> Demand | None:
        """The present demand."""
        return self.demands.at(self._service.clock(), self._service.controller.plan.n_steps)

    def health(self, with_details: bool) -> dict[str, Any]:
        """State of the loop; ``with_details`` adds the plant's address and messages that may contain it."""
        age_s, period_s = self.age_s, self.period_s
        still = f"the control loop, with a period of {period_s:g} s, has been stalled for {age_s:.0f} s"
        still = still if age_s > 2.0 * period_s else ""
        troubles = [trouble for trouble in (still, self.trouble, self.journal_trouble) if trouble]
        health: dict[str, Any] = {"cycle_age_s": round(age_s, 3), "cycle_period_s": period_s}
        if troubles:
            health["status"] = "impaired"
        if with_details:
            health["plant"] = self.address
        if shown := "; ".join(troubles if with_details else [still]):
            health["trouble"] = shown
        return health

    def run(self) -> None:
        """Control the plant until :meth:`stop`, then release it."""
        due_s = self._monotonic()
        while not self._stop.is_set():
            try:
                self.step()
            except Exception:
                LOG.exception("a control step failed")
                self._release("a control step failed; see the log")
            self._completed_s = self._monotonic()
            due_s = max(due_s + self.period_s, self._completed_s)
            while not self._stop.wait(max(0.0, min(due_s - self._monotonic(), self._refresh_in_s()))):
                if self._monotonic() >= due_s:
                    break
                self._refresh()
        self._release("the service has ended")
        self._link.close()
        self._journal.close()

    def stop(self) -> None:
        """End :meth:`run` as soon as possible."""
        self._stop.set()

    def step(self) -> Answer | None:
        """Read, decide and write once; None without measurements or demand."""
        service = self._service
        try:
            measured = self._link.read()
        except LinkError as error:
            self._failed(error)
            return None
        demand = self.active_demand()
        if demand is None:
            self._release(NO_DEMAND)
            return None
        answer = service.answer(measured, demand)
        written = None if self._shadow or self._stop.is_set() else self._write(measured, answer)
        self._journal.append(measured, demand.now_kw, answer.request_kw, written)
        if self._journal.error and self._journal.error != self.journal_trouble:
            LOG.warning(self._journal.error)
        self.journal_trouble = self._journal.error
        if self._shadow:
            self.trouble = ""
        return answer

    def _write(self, measured: Measurements, answer: Answer) -> np.ndarray | None:
        """Write the permitted set-points; return them if they arrived."""
        valid = self._service.controller.valid
        others = [] if valid is None else np.flatnonzero(valid.others).tolist()
        named = "" if valid is None else "; ".join(valid.reasons[i] for i in others)
        # One string may be under manual control; several indicate a second controller.
        self._gives_way = len(others) > 1 or (self._gives_way and bool(others))
        if self._gives_way:
            self._release(named)
            return None
        if not answer.in_service.any():
            self._release("no string is in service: " + "; ".join(answer.reasons))
            return None
        # A string that accepts or follows no set-points is not written: its last set-point expires.
        set_points = np.where(measured.available & answer.in_service, answer.request_kw, np.nan)
        if not self._send(set_points):
            return None
        self._report(named)
        self._service.controller.drives = True
        return set_points

    def _send(self, set_points: np.ndarray) -> bool:
        """Write set-points, new or refreshed; return whether they arrived."""
        self._written, self._written_at_s, self._holds = set_points, self._monotonic(), True
        try:
            self._link.write(set_points)
        except LinkError as error:
            self._failed(error)
            return False
        return True

    def _refresh_in_s(self) -> float:
        if self._written is None:
            return np.inf
        return max(0.05, self._written_at_s + self._link.refresh_s - self._monotonic())

    def _refresh(self) -> None:
        if self._written is None or self._refresh_in_s() > 0.05:
            return
        if self.active_demand() is None:
            self._release(NO_DEMAND)
        else:
            self._send(self._written)

    def _failed(self, error: LinkError) -> None:
        self._service.metrics.link_errors.inc()
        self._suspend(str(error))

    def _suspend(self, sentence: str) -> None:
        """Stop writing for now, so that the last set-points expire."""
        self._report(sentence)
        self._written = None
        # Strings cannot follow set-points that did not arrive.
        self._service.controller.drives = False

    def _report(self, sentence: str) -> None:
        """Log a new trouble once, although its countdown and its readings change."""
        if sentence and _QUANTITY.sub("", sentence) != _QUANTITY.sub("", self.trouble):
            LOG.warning(sentence)
        self.trouble = sentence

    def _release(self, sentence: str) -> None:
        """Release the plant to its own watchdog, once."""
        self._suspend(sentence)
        if not self._holds:
            return
        self._holds = False
        try:
            self._link.release()
        except LinkError as error:
            LOG.warning(f"the set-points could not be cleared ({error}); the plant's watchdog clears them")
