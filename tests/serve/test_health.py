"""Health: what is lacking shows, to whom it concerns."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi")

from http_cases import BEARER, TOKEN, TestClient
from test_control_loop import Driven

from bess.edge.plant_io import LinkError
from bess.edge.serve.app import build_app

ADDRESS = "openems at http://10.1.2.3:8084"


@pytest.fixture
def driven(tmp_path: Path) -> Iterator[Driven]:
    made = Driven(tmp_path / "state")
    yield made
    made.service.close()


def client_of(driven: Driven, token: str | None = TOKEN) -> TestClient:
    driven.cycle.address = ADDRESS
    app = build_app(driven.service, token, driven.cycle)
    return TestClient(app, base_url="http://localhost")


def health(driven: Driven, **headers: str) -> dict[str, Any]:
    return client_of(driven).get("/v1/health", headers=headers).json()  # type: ignore[no-any-return]


def test_all_is_well_while_the_demand_is_met_by_every_string(driven: Driven) -> None:
    driven.demands.post(100.0, 60.0, driven.now_s)
    driven.steps(2)
    seen = health(driven)
    assert (seen["status"], seen["unmet_kw"], seen["out_of_service"]) == ("ok", 0.0, [])


def test_power_that_is_not_met_is_told(driven: Driven) -> None:
    driven.demands.post(250.0, 60.0, driven.now_s)
    driven.steps(2)
    seen = health(driven)
    assert seen["status"] == "degraded"
    assert seen["unmet_kw"] == pytest.approx(250.0 - driven.link.power_kw.sum())
    assert seen["unmet_kw"] > 50.0


def test_strings_out_of_service_are_told(driven: Driven) -> None:
    driven.link.available[1] = False
    driven.demands.post(40.0, 60.0, driven.now_s)
    driven.steps(2)
    seen = health(driven)
    assert (seen["status"], seen["unmet_kw"], seen["out_of_service"]) == ("degraded", 0.0, [1])


def test_a_call_that_falls_short_is_told_without_a_plant_too(driven: Driven) -> None:
    client = TestClient(build_app(driven.service), base_url="http://localhost")
    strings = [{"soc": 0.5}, {"available": False}]
    client.post("/v1/split", json={"demand_kw": 150.0, "strings": strings})
    seen = client.get("/v1/health").json()
    assert (seen["status"], seen["out_of_service"]) == ("degraded", [1])
    assert seen["unmet_kw"] > 50.0


def test_no_address_is_told_without_the_token(driven: Driven) -> None:
    def fail() -> None:
        raise LinkError(f"{ADDRESS}: no answer")

    driven.link.read = fail  # type: ignore[assignment, method-assign]
    driven.steps(1)
    for token in (TOKEN, None):
        answer = client_of(driven, token).get("/v1/health")
        assert answer.json()["status"] == "impaired"
        assert "10.1.2.3" not in answer.text and "openems" not in answer.text
    seen = health(driven, **BEARER)
    assert seen["plant"] == ADDRESS
    assert seen["trouble"] == f"{ADDRESS}: no answer"


def test_a_cycle_that_stands_still_shows_within_two_periods(driven: Driven) -> None:
    driven.demands.post(100.0, 600.0, driven.now_s)
    driven.steps(2)
    period_s = driven.cycle.period_s
    driven.now_s += period_s  # as late as the start of the cycle after the one that has not ended
    assert health(driven)["status"] == "ok"
    driven.now_s += 0.5
    seen = health(driven)
    assert seen["status"] == "impaired"
    assert seen["trouble"] == "the control loop, with a period of 10 s, has been stalled for 20 s"
    assert seen["cycle_age_s"] == pytest.approx(2 * period_s + 0.5)
    text = client_of(driven).get("/metrics", headers=BEARER).text
    assert "bess_cycle_age_seconds 20.5" in text
    assert "bess_cycle_period_seconds 10.0" in text
    driven.steps(1)
    assert health(driven)["status"] == "ok"


def test_a_plant_that_hangs_in_a_call_is_told_while_it_hangs(driven: Driven) -> None:
    called, answers = threading.Event(), threading.Event()
    read = driven.link.read

    def hang() -> Any:
        called.set()
        answers.wait()
        return read()

    driven.link.read = hang  # type: ignore[method-assign]
    driven.demands.post(100.0, 600.0, driven.now_s)
    thread = threading.Thread(target=driven.cycle.run)
    thread.start()
    try:
        assert called.wait(60.0)
        driven.now_s += 2.0 * driven.cycle.period_s + 1.0
        assert "stalled for 21 s" in health(driven)["trouble"]
    finally:
        driven.cycle.stop()
        answers.set()
        thread.join()
    assert driven.cycle.age_s == 0.0
