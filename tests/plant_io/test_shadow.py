"""A plant that somebody else drives is watched: nothing is written, and the journal holds both splits."""

import dataclasses
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from plant_partners import STEP_S, Connecting, N, Rig

from bess.edge.plant_io import Measurements
from bess.edge.plant_io.journal import Journal, open_journal
from bess.edge.plant_io.journal_page import write_journal_report
from bess.edge.serve.control_loop import ControlLoop

DEMAND_KW = 60.0


def test_watching_writes_nothing_and_keeps_what_was_done_and_recommended(
    rig: Rig, connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = connecting(rig.partner.address)
    read = link.read

    def at_the_clock() -> Measurements:
        began = datetime(2026, 11, 22, tzinfo=UTC)
        return dataclasses.replace(read(), time=began + timedelta(seconds=rig.clock.now_s))

    monkeypatch.setattr(link, "read", at_the_clock)
    folder = rig.journal / "watched"
    journal = Journal(folder, rig.service.controller.system, "Watched")
    watching = ControlLoop(rig.service, link, rig.demands, journal, shadow=True, monotonic=rig.clock)
    for string in range(N):
        rig.watched.plant.ask(string, DEMAND_KW / N, np.inf)
    rig.ask(DEMAND_KW)
    rig.watched.asked.clear()
    for _ in range(30):
        answer = watching.step()
        assert answer is not None
        assert not any("does not follow" in reason for reason in answer.reasons)
        rig.clock.now_s += STEP_S
    journal.close()

    assert rig.watched.asked == []
    assert rig.power_kw() == pytest.approx(DEMAND_KW)
    data = open_journal(folder)
    assert data.sizes["time"] == 30
    assert data["power_kw"].values == pytest.approx(DEMAND_KW / N, abs=0.01)
    assert data["recommended_kw"].values.sum(axis=1) == pytest.approx(DEMAND_KW, abs=1e-3)
    assert np.isnan(data["written_kw"].values).all()
    page = write_journal_report(folder).read_text(encoding="utf-8")
    assert "Shadow mode: no set-point was written." in page
    assert "for the computed set-points" in page
