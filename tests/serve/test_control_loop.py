"""A plant that is driven: what is written, and what is not written in doubt."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fastapi")

from live_cases import measured

from bess.edge.plant_io import LinkError, Measurements
from bess.edge.plant_io.journal import Journal, open_journal
from bess.edge.serve.control_loop import ControlLoop, Demands
from bess.edge.serve.service import Service
from bess.errors import InputError
from bess.study import load_study
from patient import PATIENT


class Link:
    """A plant that follows at once, and fails on request."""

    n_strings = 2
    refresh_s = 20.0

    def __init__(self) -> None:
        self.soc = np.array([0.6, 0.5])
        self.available = np.ones(2, dtype=bool)
        self.power_kw = np.zeros(2)
        self.written: list[Any] = []
        self.released = 0
        self.fails = ""

    def read(self) -> Measurements:
        if self.fails == "read":
            raise LinkError("no answer")
        self.soc = self.soc - 1e-4
        return measured(self.soc, power_kw=self.power_kw, available=self.available)

    def write(self, power_kw: Any) -> None:
        if self.fails == "write":
            raise LinkError("not taken")
        self.written.append(power_kw)
        self.power_kw = np.nan_to_num(power_kw)

    def release(self) -> None:
        self.released += 1
        self.power_kw = np.zeros(2)

    def close(self) -> None: ...


class Driven:
    """A cycle whose clocks are turned by hand."""

    def __init__(self, folder: Path, shadow: bool = False, **values: Any) -> None:
        study = load_study(
            "policies",
            {
                "policy.name": "mpc",
                "policy.foresight_h": 2.0,
                "service.control_step_s": 10.0,
                **PATIENT,
                **values,
            },
        )
        self.service = Service(study, folder)
        self.now_s = 1.8e9
        self.service.clock = lambda: self.now_s  # type: ignore[assignment]
        self.link = Link()
        self.demands = Demands(study, 900.0)
        self.journal = Journal(folder, self.service.controller.system, "test")
        self.cycle = ControlLoop(
            self.service,
            self.link,
            self.demands,
            self.journal,
            shadow=shadow,
            monotonic=lambda: self.now_s,
        )

    def steps(self, n: int) -> Any:
        answer = None
        for _ in range(n):
            answer = self.cycle.step()
            self.cycle._completed_s = self.now_s  # as `run` does
            self.now_s += 10.0
        return answer


@pytest.fixture
def driven(tmp_path: Path):  # type: ignore[no-untyped-def]
    made = Driven(tmp_path / "state")
    yield made
    made.service.close()


def test_a_demand_that_was_posted_reaches_the_plant(driven: Driven) -> None:
    driven.demands.post(100.0, 60.0, driven.now_s)
    driven.steps(3)
    assert driven.link.power_kw.sum() == pytest.approx(100.0)
    assert driven.cycle.trouble == ""


def test_without_a_demand_nothing_is_written_and_the_plant_is_let_go_once(driven: Driven) -> None:
    driven.steps(2)
    assert driven.link.written == []
    assert driven.link.released == 0
    driven.demands.post(100.0, 30.0, driven.now_s)
    driven.steps(6)
    assert len(driven.link.written) == 3
    assert driven.link.released == 1
    assert "there is no demand" in driven.cycle.trouble


def test_zero_is_written_only_when_zero_is_asked(driven: Driven) -> None:
    driven.demands.post(100.0, 1000.0, driven.now_s)
    driven.steps(2)
    for driven.link.fails in ("read", "write"):
        before = len(driven.link.written)
        driven.steps(3)
        assert len(driven.link.written) == before
        driven.link.fails = ""
        driven.steps(1)
        assert driven.link.written[-1].sum() == pytest.approx(100.0)
    driven.demands.post(0.0, 1000.0, driven.now_s)
    driven.steps(1)
    assert not driven.link.written[-1].any()


def test_a_string_that_takes_no_set_points_is_left_alone(driven: Driven) -> None:
    driven.demands.post(80.0, 1000.0, driven.now_s)
    driven.link.available[0] = False
    driven.steps(2)
    assert np.isnan(driven.link.written[-1][0])
    assert driven.link.written[-1][1] == pytest.approx(80.0)


def test_with_no_string_left_the_plant_is_let_go(driven: Driven) -> None:
    driven.demands.post(80.0, 1000.0, driven.now_s)
    driven.steps(2)
    driven.link.soc = np.array([5.0, 5.0])
    driven.steps(2)
    assert driven.link.released == 1
    assert "is implausible" in driven.cycle.trouble
    driven.link.soc = np.array([0.6, 0.5])
    driven.steps(2)
    assert driven.link.power_kw.sum() == pytest.approx(80.0)


def test_a_countdown_is_one_warning(driven: Driven, caplog: pytest.LogCaptureFixture) -> None:
    driven.demands.post(80.0, 1000.0, driven.now_s)
    driven.steps(1)
    read = driven.link.read
    power_kw = np.array([39_000.0, 39_000.0])
    driven.link.read = lambda: replace(read(), power_kw=power_kw)  # type: ignore[method-assign]
    driven.steps(2)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "tried again in 10 s" in driven.cycle.trouble
    driven.link.available[:] = False
    driven.steps(1)
    assert len(caplog.records) == 2


def test_set_points_are_written_again_before_they_lapse(driven: Driven) -> None:
    driven.demands.post(80.0, 1000.0, driven.now_s)
    driven.steps(1)
    before = len(driven.link.written)
    driven.now_s += 5.0
    driven.cycle._refresh()
    assert len(driven.link.written) == before
    driven.now_s += 15.0
    driven.cycle._refresh()
    assert len(driven.link.written) == before + 1


def test_a_shadow_writes_nothing_and_keeps_a_journal(tmp_path: Path) -> None:
    made = Driven(tmp_path / "state", shadow=True)
    made.demands.post(80.0, 1000.0, made.now_s)
    made.link.power_kw = np.array([10.0, 70.0])  # somebody else drives
    answer = made.steps(20)
    made.journal.close()
    made.service.close()
    assert made.link.written == []
    assert made.link.released == 0
    assert answer.request_kw.sum() == pytest.approx(80.0)
    journal = open_journal(tmp_path / "state")
    assert journal.sizes["time"] == 20
    np.testing.assert_allclose(journal["power_kw"][-1], [10.0, 70.0])
    assert np.isnan(journal["written_kw"]).all()


def test_a_gap_in_the_journal_is_told(driven: Driven, tmp_path: Path) -> None:
    app = driven.cycle
    driven.demands.post(80.0, 1000.0, driven.now_s)
    driven.steps(1)
    assert "status" not in app.health(with_details=True)
    driven.journal._close_day()
    folder = (tmp_path / "state" / "journal").rename(tmp_path / "elsewhere")
    driven.steps(1)
    assert app.health(with_details=True)["status"] == "impaired"
    assert "the journal of the plant has a gap" in app.health(with_details=True)["trouble"]
    assert driven.link.power_kw.sum() == pytest.approx(80.0)
    folder.rename(tmp_path / "state" / "journal")
    driven.steps(1)
    assert "status" not in app.health(with_details=True)
    driven.journal.close()


def test_a_forecast_that_was_posted_moves_on_with_time(driven: Driven) -> None:
    began_s = 900.0 * (driven.now_s // 900.0)
    driven.demands.post([10.0, 20.0, 30.0], 3600.0, began_s)
    now = driven.demands.at(began_s + 950.0, 8)
    assert now is not None and now.now_kw == 20.0 and now.forecast_kw == [20.0, 30.0]
    assert driven.demands.at(began_s + 2800.0, 8) is None


def test_a_demand_that_lapses_between_two_steps_is_not_refreshed(driven: Driven) -> None:
    driven.demands.post(80.0, 15.0, driven.now_s)
    driven.steps(1)
    written = len(driven.link.written)
    driven.now_s += 10.0
    driven.cycle._refresh()
    assert len(driven.link.written) == written
    assert driven.link.released == 1
    assert "there is no demand" in driven.cycle.trouble


def test_a_profile_is_followed_only_where_the_study_asks_for_it() -> None:
    values = {"demand.repeat": True, "service.follow_profile": True}
    demands = Demands(load_study("policies", values), 900.0)
    day = [demands.at(1.8e9 + 900.0 * k, 4) for k in range(192 * 2)]
    followed = [asked.now_kw for asked in day if asked is not None]
    assert len(followed) == 384
    assert max(followed) > 0.0 > min(followed)
    assert followed[:192] == followed[192:]
    once = Demands(load_study("policies", {**values, "demand.repeat": False}), 900.0)
    assert once.at(1.8e9, 4) is None
    unasked = Demands(load_study("policies", {"demand.repeat": True}), 900.0)
    unasked.post(50.0, 60.0, 1.8e9)
    assert unasked.at(1.8e9 + 59.0, 4) is not None
    assert [unasked.at(1.8e9 + 60.0 + 900.0 * k, 4) for k in range(192)] == [None] * 192


def test_a_study_without_a_profile_cannot_ask_for_it_to_be_followed() -> None:
    study = load_study("fcr", {"service.follow_profile": True})
    with pytest.raises(InputError, match=r"service.follow_profile = true, and \[demand\] is of kind"):
        Demands(study, 900.0)


def test_a_cycle_that_stands_shows_by_its_age(driven: Driven) -> None:
    began = threading.Event()
    hang = threading.Event()

    def read() -> Measurements:
        began.set()
        hang.wait()
        raise LinkError("no answer")

    driven.link.read = read  # type: ignore[method-assign]
    thread = threading.Thread(target=driven.cycle.run)
    thread.start()
    began.wait()
    driven.now_s += 25.0
    assert driven.cycle.age_s > 2.0 * driven.cycle.period_s
    hang.set()
    driven.cycle.stop()
    thread.join()
    assert driven.cycle.age_s == 0.0


def test_an_answer_tells_what_is_unmet_and_who_is_out(driven: Driven) -> None:
    driven.demands.post(180.0, 1000.0, driven.now_s)
    driven.link.available[0] = False
    answer = driven.steps(2)
    assert answer.unmet_kw == pytest.approx(88.0)
    assert answer.in_service.tolist() == answer.document()["in_service"] == [False, True]


def test_a_ramp_begins_at_the_power_of_a_plant_that_was_let_go(tmp_path: Path) -> None:
    """60 kW of discharge lapse; five minutes later, with the plant at rest, the demand is to charge 60 kW."""
    driven = Driven(tmp_path / "state", **{"service.ramp_kw_per_s": 1.0})
    driven.demands.post(60.0, 100.0, driven.now_s)
    driven.steps(10)
    assert driven.link.power_kw.sum() == pytest.approx(60.0)
    driven.steps(30)
    assert not driven.link.power_kw.any()
    driven.demands.post(-60.0, 900.0, driven.now_s)
    assert [driven.steps(1).request_kw.sum() for _ in range(7)] == pytest.approx(
        [-10.0, -20.0, -30.0, -40.0, -50.0, -60.0, -60.0]
    )
    driven.service.close()
