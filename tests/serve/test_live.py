"""What the live page is told: reasons in groups, a history that ends, energy that is left."""

from pathlib import Path

import numpy as np
import pytest
from live_cases import measured

from bess.edge.serve.answer import Demand
from bess.edge.serve.monitoring import MAX_LINES, SPANS, History
from bess.edge.serve.page import grouped, live
from bess.edge.serve.service import Service
from bess.study import load_study


def test_strings_of_one_reason_stand_together_those_out_of_service_first() -> None:
    said = ["string 0 runs: hot, 51.5 °C", "string 1 rests: it is late", "string 2 runs: hot, 48 °C"]
    assert grouped(said, np.array([True, False, True])) == [
        {"text": "rests: it is late", "strings": [1], "in_service": False},
        {"text": "runs: hot, 48 to 51.5 °C", "strings": [0, 2], "in_service": True},
    ]


@pytest.mark.parametrize("n", [2, MAX_LINES + 1])
def test_a_history_keeps_means_of_each_span_and_no_more(n: int) -> None:
    history = History()
    unknown = {"foreseen_kw": np.nan, "measured_kw": np.nan, "starts": 1.0, "hottest_c": 30.0}
    soc = np.linspace(0.2, 0.8, n)
    for minute in range(8 * 24 * 60):
        plant = {"time_s": 60.0 * minute, "demand_kw": float(minute % 2), "request_kw": 1.0, **unknown}
        history.add(plant, soc, np.ones(n))
    for name, (every_s, most) in SPANS.items():
        said = history.document(name)
        assert said["every_s"] == every_s
        assert most - 1 <= len(said["time_s"]) <= most + 1
        assert said["time_s"][-1] - said["time_s"][0] == pytest.approx(every_s * most, abs=2.0 * every_s)
        assert said["foreseen_kw"][0] is None
        assert [column[0] for column in said["soc"]] == pytest.approx([0.2, 0.26, 0.5, 0.74, 0.8], abs=1e-4)
        assert len(said["string_soc"]) == len(said["string_kw"]) == (n if n <= MAX_LINES else 0)
    assert np.mean(history.document("week")["demand_kw"]) == pytest.approx(0.5, abs=0.01)


def test_a_young_history_is_shown_by_the_minute_whatever_is_asked() -> None:
    history = History()
    assert history.document("week")["time_s"] == []
    names = ("demand_kw", "request_kw", "measured_kw", "foreseen_kw", "starts", "hottest_c")
    for minute in range(3):
        history.add({"time_s": 60.0 * minute} | dict.fromkeys(names, 0.0), np.array([0.5]), np.array([0.0]))
    assert history.document("week")["time_s"] == [0.0, 60.0, 120.0]


def test_the_energy_left_is_that_of_strings_in_service_above_their_floor(tmp_path: Path) -> None:
    study = load_study("policies", {"system.n_strings": 3, "policy.name": "soc", "service.soc_floor": 0.2})
    service = Service(study, tmp_path)
    nothing = live(service, "day")
    assert (nothing["last"], nothing["status"]) == (None, "no demand yet")
    service.answer(measured([0.6, 0.5, 0.9], available=[True, True, False]), Demand(60.0))
    said = live(service, "day")["last"]
    energy_kwh = service.controller.system.nominal_energy_kwh
    assert said["discharge_kwh"] == pytest.approx(0.4 * energy_kwh[0] + 0.3 * energy_kwh[1])
    assert said["discharge_kw"] <= service.controller.system.nominal_kw[:2].sum() + 1e-9
    assert said["because"][0]["strings"] == [2]
    service.close()


def test_what_was_foreseen_an_hour_before_is_told_when_its_time_comes(tmp_path: Path) -> None:
    service = Service(load_study("policies", {"system.n_strings": 2, "policy.name": "mpc"}), tmp_path)
    began_s = 900.0 * (service.clock() // 900.0)
    for step in range(5):
        service.clock = lambda step=step: began_s + 900.0 * step  # type: ignore[assignment,misc]
        service.answer(measured([0.5, 0.5]), Demand.of([10.0 + step, *(30.0 + step,) * 7]))
    foreseen = service.history.document("2h")["foreseen_kw"]
    assert foreseen == [None, None, None, None, 30.0]
    service.close()


def test_a_controller_that_never_answered_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    service = Service(load_study("policies", {"system.n_strings": 2, "policy.name": "soc"}), tmp_path)

    def fails(*_: object, **__: object) -> None:
        raise ArithmeticError("0/0")

    monkeypatch.setattr(service.controller, "step", fails)
    assert service.answer(measured([0.6, 0.5]), Demand(60.0)).fallback
    service.close()  # the fallback has been taken note of
    said = live(service, "day")
    assert said["last"] is None
    assert "0/0" in said["status"]
