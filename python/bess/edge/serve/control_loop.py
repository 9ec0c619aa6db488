"""A plant that is driven, or only watched: read, decide, write, again and again.

Whatever is in doubt is not written: the plant's own watchdog then lets the last set-point lapse. Nothing here
writes a zero because it does not know better.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from bess.edge.plant_io import LinkError, Measurements, PlantLink
from bess.edge.plant_io.journal import Journal
from bess.edge.serve.answer import Answer
from bess.edge.serve.demands import ActiveDemand, Demands
from bess.edge.serve.service import LOG, Service

STEP_S: Final = 10.0
"""Control step of a driven plant unless the settings say otherwise."""
NO_DEMAND: Final = "there is no demand: post one to /v1/demand"


class ControlLoop:
    """Drives a plant by the controller of a service.

    Parameters
    ----------
    service
        Decides.
    link
        To the plant; used from the thread of :meth:`run` alone.
    demands
        What is asked.
    journal
        Where every reading is taken down; None for nowhere.
    shadow
        Read and recommend, and write nothing.
    """

    def __init__(
        self,
        service: Service,
        link: PlantLink,
        demands: Demands,
        journal: Journal | None = None,
        *,
        shadow: bool = False,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._service, self._link, self._demands, self._journal = service, link, demands, journal
        self._shadow = shadow
        self._monotonic = monotonic
        self._stop = threading.Event()
        self._written: np.ndarray | None = None
        self._written_at_s = -np.inf
        self._holds = self._gives_way = False
        self._completed_s = monotonic()
        self.trouble = "the plant has not been read yet"
        self.journal_trouble = ""
        service.controller.drives = False

    @property
    def period_s(self) -> float:
        """Time from one cycle to the next [s]."""
        return self._service.controller.step_s

    @property
    def age_s(self) -> float:
        """Time since a cycle was last completed, whatever came of it [s]; above two periods, it stands."""
        return self._monotonic() - self._completed_s

    def run(self) -> None:
        """Go on until :meth:`stop`; then let go of the plant."""
        due_s = self._monotonic()
        while not self._stop.is_set():
            try:
                self.step()
            except Exception:
                LOG.exception("a control step failed")
                self._let_go("a control step failed; the log says why")
            self._completed_s = self._monotonic()
            due_s = max(due_s + self.period_s, self._completed_s)
            while not self._stop.wait(max(0.0, min(due_s - self._monotonic(), self._refresh_in_s()))):
                if self._monotonic() >= due_s:
                    break
                self._refresh()
        self._let_go("the service has ended")
        self._link.close()
        if self._journal is not None:
            self._journal.close()

    def stop(self) -> None:
        """End :meth:`run` as soon as it can."""
        self._stop.set()

    def step(self) -> Answer | None:
        """Read, decide, write once; None if there was nothing to act upon."""
        service = self._service
        try:
            measured = self._link.read()
        except LinkError as error:
            self._failed(error)
            return None
        asked = self._asked()
        if asked is None:
            self._let_go(NO_DEMAND)
            return None
        answer = service.answer(measured, asked.demand_kw, asked.forecast_kw)
        written = None if self._shadow or self._stop.is_set() else self._write(measured, answer)
        if self._journal is not None:
            self._journal.append(measured, asked.demand_kw, answer.request_kw, written)
            if self._journal.error and self._journal.error != self.journal_trouble:
                LOG.warning(self._journal.error)
            self.journal_trouble = self._journal.error
        if self._shadow:
            self.trouble = ""
        return answer

    def _write(self, measured: Measurements, answer: Answer) -> np.ndarray | None:
        """Write what may be written; return what has arrived."""
        trusted = self._service.controller.trusted
        others = [] if trusted is None else np.flatnonzero(trusted.others).tolist()
        named = "" if trusted is None else "; ".join(trusted.reasons[i] for i in others)
        # One string may be in the hands of a technician; several are those of a second controller.
        self._gives_way = len(others) > 1 or (self._gives_way and bool(others))
        if self._gives_way:
            self._let_go(named)
            return None
        if not answer.in_service.any():
            self._let_go("no string is in service: " + "; ".join(answer.reasons))
            return None
        # A string that takes no set-points, or follows none, is not written: what it was given lapses.
        set_points = np.where(measured.available & answer.in_service, answer.request_kw, np.nan)
        if not self._send(set_points):
            return None
        self._say(named)
        self._service.controller.drives = True
        return set_points

    def _send(self, set_points: np.ndarray) -> bool:
        """Write set-points, for the first time or again; whether they arrived."""
        self._written, self._written_at_s, self._holds = set_points, self._monotonic(), True
        try:
            self._link.write(set_points)
        except LinkError as error:
            self._failed(error)
            return False
        return True

    def _refresh_in_s(self) -> float:
        """Time until the set-points must be written again."""
        if self._shadow or self._written is None:
            return np.inf
        return max(0.05, self._written_at_s + self._link.refresh_s - self._monotonic())

    def _refresh(self) -> None:
        if self._shadow or self._written is None:
            return
        if self._monotonic() - self._written_at_s < self._link.refresh_s - 0.05:
            return
        if self._asked() is None:
            self._let_go(NO_DEMAND)
        else:
            self._send(self._written)

    def _asked(self) -> ActiveDemand | None:
        return self._demands.at(self._service.clock(), self._service.controller.plan.n_steps)

    def _failed(self, error: LinkError) -> None:
        """Count what the link could not do; write nothing more for now."""
        self._service.metrics.link_errors.inc()
        self._doubt(str(error))

    def _doubt(self, sentence: str) -> None:
        """Write nothing more for now: what was written lapses by itself."""
        self._say(sentence)
        self._written = None
        # Strings cannot follow what did not reach them.
        self._service.controller.drives = False

    def _say(self, sentence: str) -> None:
        if sentence and sentence != self.trouble:
            LOG.warning(sentence)
        self.trouble = sentence

    def _let_go(self, sentence: str) -> None:
        """Give the plant back to its own watchdog, once."""
        self._doubt(sentence)
        if self._shadow or not self._holds:
            return
        self._holds = False
        try:
            self._link.release()
        except LinkError as error:
            LOG.warning(f"the plant could not be told ({error}); its watchdog takes over")
