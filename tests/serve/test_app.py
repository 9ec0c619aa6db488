"""The service over HTTP: what it answers, whom it lets in, and how it says no."""

import json
import logging
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fastapi")

from http_cases import TestClient

from bess.checkpoints import to_json
from bess.edge.serve.app import build_app
from bess.edge.serve.gate import MAX_BODY
from bess.edge.serve.service import Service
from bess.edge.serve.state_store import MEMORY
from bess.study import load_study
from patient import PATIENT

JSON = {"Content-Type": "application/json"}
STRING = {"soc": 0.5, "temperature_c": 25.0}
GOOD = {"demand_kw": 78.0, "strings": [STRING, {**STRING, "limit_kw": 92.0, "available": True}]}


def study(**values):  # type: ignore[no-untyped-def]
    return load_study("policies", {"policy.name": "mpc", "policy.foresight_h": 2.0, **PATIENT, **values})


@pytest.fixture
def service(tmp_path: Path):  # type: ignore[no-untyped-def]
    made = Service(study(), tmp_path / "state")
    yield made
    made.close()


def client_of(service: Service) -> TestClient:
    return TestClient(build_app(service), base_url="http://localhost", raise_server_exceptions=False)


@pytest.fixture
def client(service: Service):  # type: ignore[no-untyped-def]
    return client_of(service)


def test_a_demand_is_shared(client: TestClient) -> None:
    answer = client.post("/v1/split", json=GOOD).json()
    assert {
        "request_kw", "plan_kw", "status", "gap", "fallback", "unmet_kw", "valid_for_s", "solve_time_s"
    } <= answer.keys()  # fmt: skip
    assert sum(answer["request_kw"]) == pytest.approx(78.0)
    assert answer["plan_kw"] == [[p] for p in answer["request_kw"]]
    assert answer["valid_for_s"] == 900.0
    assert answer["fallback"] is False
    assert answer["unmet_kw"] == 0.0


def test_a_forecast_brings_a_plan_of_its_length(client: TestClient) -> None:
    ahead = [78.0, 120.0, -60.0, 0.0]
    answer = client.post("/v1/split", json={**GOOD, "demand_kw": ahead}).json()
    np.testing.assert_allclose(np.sum(answer["plan_kw"], axis=0), ahead)
    np.testing.assert_allclose(np.array(answer["plan_kw"])[:, 0], answer["request_kw"])


def test_a_string_out_of_service_needs_no_measurements_and_is_in_the_log(
    client: TestClient, caplog: pytest.LogCaptureFixture
) -> None:
    strings = [{"available": False}, STRING]
    with caplog.at_level(logging.INFO, logger="bess.serve"):
        answer = client.post("/v1/split", json={"demand_kw": -60.0, "strings": strings}).json()
    (line,) = (record for record in caplog.records if record.getMessage() == "answer")
    assert line.fields["out_of_service"] == answer["reasons"][:1]  # type: ignore[attr-defined]
    assert answer["request_kw"] == [0.0, -60.0]
    assert answer["reasons"][0] == "string 0 rests: out of service, says the plant"


BAD = {
    "no JSON": (b"{", "the body is not JSON"),
    "empty": (b"", "the body is not JSON"),
    "no text": (b"\xff\xfe{}", "the body is not JSON"),
    "NaN": (b'{"demand_kw": NaN, "strings": []}', "demand_kw = nan: must be a finite number"),
    "infinite": (b'{"demand_kw": -Infinity, "strings": []}', "demand_kw = -inf: must be a finite number"),
    "overflow": (b'{"demand_kw": 1e999, "strings": [{"soc": 0.5}, {"soc": 0.5}]}', "demand_kw = inf"),
    "many digits": (b'{"demand_kw": ' + b"9" * 5000 + b"}", "the body is not JSON"),
    "nested": (b"[" * 60000, "nested too deeply"),
    "a list": (b"[]", "must be a JSON object"),
    "no strings": (b'{"demand_kw": 5}', "strings: missing"),
    "no demand": (b'{"strings": []}', "demand_kw: missing"),
    "text": (b'{"demand_kw": "5", "strings": []}', "demand_kw = '5': must be a number"),
    "no numbers": (
        b'{"demand_kw": [], "strings": []}',
        "demand_kw: must be a number or a list of at least 1, not of 0",
    ),
    "second number": (
        b'{"demand_kw": [5, 1e7], "strings": []}',
        "demand_kw[1] = 10000000.0: must be in [-1e+06, 1e+06] kW",
    ),
    "no list": (b'{"demand_kw": 5, "strings": 3}', "strings = 3: must be a list"),
    "truth": (b'{"demand_kw": true, "strings": []}', "demand_kw = True: must be a number"),
    "huge": (b'{"demand_kw": 1e9, "strings": [{"soc": 0.5}, {"soc": 0.5}]}', "[-1e+06, 1e+06] kW"),
    "one string": (b'{"demand_kw": 5, "strings": [{"soc": 0.5}]}', "1 entries for a system of 2 strings"),
    "soc": (b'{"demand_kw": 5, "strings": [{"soc": 50}, {"soc": 0.5}]}', "strings[0].soc = 50"),
    "no soc": (b'{"demand_kw": 5, "strings": [{}, {"soc": 0.5}]}', "strings[0].soc: missing"),
    "hot": (
        b'{"demand_kw": 5, "strings": [{"soc": 0.5, "temperature_c": 300}, {"soc": 0.5}]}',
        "[-40, 90] degC",
    ),
    "limit": (
        b'{"demand_kw": 5, "strings": [{"soc": 0.5, "limit_kw": -1}, {"soc": 0.5}]}',
        "strings[0].limit_kw = -1",
    ),
    "limit by a hair": (
        b'{"demand_kw": 5, "strings": [{"soc": 0.5, "limit_kw": 92.00001}, {"soc": 0.5}]}',
        "strings[0].limit_kw = 92.00001: must be in [0, 92] kW",
    ),
    "twice": (
        b'{"demand_kw": 5, "demand_kw": 50, "strings": [{"soc": 0.5}, {"soc": 0.5}]}',
        "the key 'demand_kw' occurs twice in one object; give it once",
    ),
    "twice within": (
        b'{"demand_kw": 5, "strings": [{"soc": 0.5, "soc": 0.9}, {"soc": 0.5}]}',
        "the key 'soc' occurs twice in one object; give it once",
    ),
    "unknown": (
        b'{"demand_kw": 5, "strings": [{"SoC": 0.5}, {"soc": 0.5}]}',
        "strings[0].SoC: unknown key; allowed: available, limit_kw, power_kw, soc, temperature_c",
    ),
    "mistyped": (b'{"demand_w": 5, "strings": []}', "demand_w: unknown key; did you mean 'demand_kw'?"),
}


@pytest.mark.parametrize("body", BAD)
def test_bad_values_are_refused_in_one_sentence(client: TestClient, body: str) -> None:
    content, words = BAD[body]
    answer = client.post("/v1/split", content=content, headers=JSON)
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]


def test_a_long_body_is_not_read_to_its_end(client: TestClient) -> None:
    answer = client.post("/v1/split", content=b" " * (MAX_BODY + 1), headers=JSON)
    assert answer.status_code == 413
    assert answer.json()["detail"] == f"POST /v1/split: the body is longer than {MAX_BODY} bytes"


def test_routes_that_there_are_not(client: TestClient) -> None:
    assert client.get("/v1/nothing").status_code == 404
    assert client.get("/v1/split").status_code == 405


class Panic(BaseException):
    """As the core's, which is not an Exception."""


@pytest.mark.parametrize("kind", [ZeroDivisionError, Panic])
def test_a_controller_that_fails_is_answered_for_by_the_fallback(
    kind: type[BaseException],
    client: TestClient,
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise kind("on purpose")

    monkeypatch.setattr(service.controller, "step", fail)
    strings = [{"soc": 0.8}, {"soc": 0.4}]
    with caplog.at_level(logging.CRITICAL):
        answer = client.post("/v1/split", json={"demand_kw": 60.0, "strings": strings}).json()
    assert answer["fallback"] is True
    np.testing.assert_allclose(answer["request_kw"], [40.0, 20.0])
    assert f"{kind.__name__}: on purpose" in answer["status"]


def test_an_answer_that_is_not_ready_in_time_comes_from_the_fallback(tmp_path: Path) -> None:
    import time

    made = Service(study(**{"service.answer_within_s": 0.05}), tmp_path / "state")
    slow = made.controller.step

    def sleepy(*arguments, **others):  # type: ignore[no-untyped-def]
        time.sleep(0.3)
        return slow(*arguments, **others)

    made.controller.step = sleepy  # type: ignore[method-assign]
    answer = client_of(made).post("/v1/split", json=GOOD).json()
    made.close()
    assert answer["fallback"] is True
    assert sum(answer["request_kw"]) == pytest.approx(78.0)
    assert "no answer within 0.05 s" in answer["status"]
    # What was sent is what is remembered, not what came too late.
    np.testing.assert_allclose(made.controller.last_kw, answer["request_kw"])


def test_metrics_and_health_tell_what_happened(client: TestClient) -> None:
    client.post("/v1/split", json=GOOD)
    client.post("/v1/split", content=b"x", headers=JSON)
    text = client.get("/metrics").text
    assert 'bess_requests_total{path="/v1/split",status="200"} 1.0' in text
    assert 'bess_requests_total{path="/v1/split",status="422"} 1.0' in text
    assert re.search(r'bess_request_kw\{string="1"\} \d', text)
    health = client.get("/v1/health").json()
    assert health["status"] == "ok"
    assert health["answers"] == 1


def test_the_pages_load_nothing_from_elsewhere(client: TestClient) -> None:
    for path in ("/", "/docs"):
        answer = client.get(path)
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert not re.search(r'(src|href)="(https?:)?//', answer.text)


def test_the_reference_names_every_route(client: TestClient) -> None:
    schema = client.get("/openapi.json").json()
    assert {"/v1/split", "/v1/health", "/metrics", "/v1/calibration", "/"} <= schema["paths"].keys()
    assert "soc" in schema["components"]["schemas"]["StringMessage"]["properties"]
    assert "POST /v1/split" in client.get("/docs").text


def test_the_schema_tells_media_types_and_which_route_needs_no_token(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    for path, kind in {"/": "text/html", "/metrics": "text/plain", "/v1/health": "application/json"}.items():
        assert list(paths[path]["get"]["responses"]["200"]["content"]) == [kind]
        assert client.get(path).headers["content-type"].startswith(kind)
    open_ones = [path for path, routes in paths.items() if any({} in r["security"] for r in routes.values())]
    assert open_ones == ["/v1/health"]


def test_openems_is_answered_in_per_cent(client: TestClient) -> None:
    body = {"SetActivePower": 150_000, "powerDistribution": {"ess0": {"soc": 50}, "ess1": {"soc": 60}}}
    answer = client.post("/v1/openems-solver", json=body).json()
    shares = [answer["powerDistribution"][name]["pdist"] for name in ("ess0", "ess1")]
    assert sum(shares) == pytest.approx(100.0)
    assert client.post("/v1/openems-solver", json={"SetActivePower": 0}).status_code == 422
    assert client.post("/v1/openems-solver", content=b"{", headers=JSON).status_code == 422


@pytest.mark.parametrize(
    ("power", "name"), [("5e-324", "ess0"), ("9", "\\ud800"), ("9", "ess\u00b2"), ("9", "ess" + 5000 * "9")]
)
def test_no_solver_request_is_a_failure_of_the_service(client: TestClient, power: str, name: str) -> None:
    body = (
        f'{{"SetActivePower": {power}, "powerDistribution": {{"{name}": {{"soc": 50}}, "b": {{"soc": 50}}}}}}'
    )
    answer = client.post("/v1/openems-solver", content=body.encode(), headers=JSON)
    assert answer.status_code == 422, answer.text
    assert "expected" in answer.json()["detail"]


def test_a_fallback_leaves_out_the_strings_that_are_out(client: TestClient, service: Service) -> None:
    """String 1 of 2 is said to be available, gives 50 kW whatever is set, and is counted with that."""
    strings = [{**STRING, "power_kw": 50.0}, {**STRING, "power_kw": 50.0}]
    for _ in range(3):
        answer = client.post("/v1/split", json={"demand_kw": 0.0, "strings": strings}).json()
        strings[0] = {**STRING, "power_kw": answer["request_kw"][0]}
    assert answer["in_service"] == [True, False] and answer["flowing_kw"] == [0.0, 50.0]
    service.controller.plan.update = None  # type: ignore[assignment, method-assign]
    answer = client.post("/v1/split", json={"demand_kw": 80.0, "strings": strings}).json()
    assert answer["fallback"] and answer["in_service"] == [True, False]
    assert answer["request_kw"] == pytest.approx([30.0, 0.0])


def test_all_readings_of_a_thousand_strings_fit_into_one_request(tmp_path: Path) -> None:
    service = Service(study(**{"system.n_strings": 1000}), tmp_path / "state")
    string = {
        "soc": 0.5123456789012345,
        "temperature_c": 25.123456789012345,
        "limit_kw": 91.23456789012345,
        "available": True,
        "power_kw": -12.345678901234567,
    }
    forecast = [-12345.678901234567] * 192
    answer = client_of(service).post("/v1/split", json={"demand_kw": forecast, "strings": [string] * 1000})
    assert answer.status_code == 200, answer.text
    service.close()


def test_calibration_over_http(client: TestClient) -> None:
    assert client.post("/v1/calibration", json={"string": 1}).status_code == 200
    answer = client.post("/v1/split", json={**GOOD, "demand_kw": 0.0}).json()
    assert answer["request_kw"][1] < 0.0 < answer["request_kw"][0]
    assert client.post("/v1/calibration", json={"string": 7}).status_code == 422
    assert client.delete("/v1/calibration").json() == {"calibrating": None}


def test_a_restart_continues_and_damage_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "state"
    first = Service(study(), folder)
    client = client_of(first)
    for demand_kw in (20.0, 70.0, -30.0):
        client.post("/v1/split", json={**GOOD, "demand_kw": demand_kw})
    before, plan = json.loads(to_json(first.controller.state_dict())), first.controller.plan.current
    first.close()
    second = Service(study(), folder)
    second.close()
    assert json.loads(to_json(second.controller.state_dict())) == before
    assert plan is not None and second.controller.plan.current is not None
    np.testing.assert_array_equal(second.controller.plan.current.request_kw, plan.request_kw)
    assert any("continues with the state" in note for note in second.notes)

    # The newer of the two files is torn: what was before it counts, and nobody is told.
    newest = max(MEMORY, key=lambda name: json.loads((folder / name).read_bytes().split(b"\n")[1])["number"])
    content = (folder / newest).read_bytes()
    (folder / newest).write_bytes(content[:-20])
    torn = Service(study(), folder)
    torn.close()
    assert torn.controller.answers == before["answers"] - 1

    for name in MEMORY:
        (folder / name).write_bytes(content[:-20] + b"x" * 20)
    with caplog.at_level(logging.WARNING, logger="bess.serve"):
        third = Service(study(), folder)
    third.close()
    assert any("is damaged" in record.getMessage() for record in caplog.records)
    assert third.controller.answers == 0
    assert any("is damaged" in note and "set aside" in note for note in third.notes)
    assert (folder / f"{MEMORY[0]}.damaged").exists()


def test_the_state_of_another_system_is_not_taken_over(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    first = Service(study(), folder)
    client_of(first).post("/v1/split", json=GOOD)
    first.close()
    second = Service(study(**{"system.n_strings": 3}), folder)
    second.close()
    assert any("is of another system" in note for note in second.notes)
