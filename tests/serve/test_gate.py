"""Who may call the service: no page of another origin, no name but its own, nobody without its token."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi")

from http_cases import BEARER, TOKEN, TestClient

from bess.edge.serve.app import build_app
from bess.edge.serve.gate import Names, Rate, check_token, exposure, is_allowed, read_token
from bess.edge.serve.service import Service
from bess.errors import InputError
from bess.study import load_study
from commands import refused

STRING = {"soc": 0.5, "temperature_c": 25.0}
GOOD = {"demand_kw": 78.0, "strings": [STRING, STRING]}
POSTS = ("/v1/split", "/v1/demand", "/v1/calibration", "/v1/openems-solver", "/v1/nothing")
GETS = ("/", "/docs", "/openapi.json", "/metrics", "/v1/live", "/v1/health", "/v1/nothing")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    made = Service(
        load_study(
            "policies", {"policy.name": "mpc", "policy.foresight_h": 2.0, "service.requests_per_s": 5.0}
        ),
        tmp_path_factory.mktemp("state"),
    )
    yield made
    made.close()


@pytest.fixture
def client(service: Service) -> TestClient:
    return TestClient(build_app(service), base_url="http://localhost:8080")


@pytest.fixture
def closed(service: Service) -> TestClient:
    return TestClient(build_app(service, TOKEN), base_url="http://localhost:8080")


@pytest.mark.parametrize("path", POSTS)
@pytest.mark.parametrize(
    "kind",
    [None, "", "text/plain", "text/plain;charset=UTF-8", "application/x-www-form-urlencoded",
     "multipart/form-data; boundary=x", "text/plain; application/json", "application/jsonp",
     "text/plain, application/json"],
)  # fmt: skip
def test_what_a_form_of_any_page_can_send_is_no_request(
    client: TestClient, service: Service, path: str, kind: str | None
) -> None:
    headers = {} if kind is None else {"Content-Type": kind}
    answer = client.post(path, content=json.dumps({"string": 0}).encode(), headers=headers)
    assert answer.status_code == 415
    assert "application/json" in answer.json()["detail"]
    assert service.controller.calibration.string is None


def test_json_may_be_named_as_the_standard_allows(client: TestClient) -> None:
    for kind in ("application/json", "Application/JSON", "application/json; charset=utf-8"):
        answer = client.post("/v1/split", content=json.dumps(GOOD), headers={"Content-Type": kind})
        assert answer.status_code == 200, kind


FOREIGN: dict[str, dict[str, str]] = {
    "another site": {"Origin": "http://evil.example"},
    "its sandbox": {"Origin": "null"},
    "another port of this machine": {"Origin": "http://localhost:3000"},
    "the same name without a port": {"Origin": "http://localhost"},
    "a name that begins like ours": {"Origin": "http://localhost:8080.evil.example"},
    "a name that ends like ours": {"Origin": "http://evil.example/localhost:8080"},
    "no origin at all": {"Origin": ""},
    "cross-site": {"Sec-Fetch-Site": "cross-site"},
    "same-site": {"Sec-Fetch-Site": "same-site"},
    "own origin, foreign site": {"Origin": "http://localhost:8080", "Sec-Fetch-Site": "cross-site"},
}


@pytest.mark.parametrize("headers", FOREIGN.values(), ids=FOREIGN)
def test_pages_of_other_origins_are_refused_on_every_path(
    client: TestClient, closed: TestClient, service: Service, headers: dict[str, str]
) -> None:
    answers = service.controller.answers
    for path in POSTS:
        assert client.post(path, json=GOOD, headers=headers).status_code == 403, path
        assert closed.post(path, json=GOOD, headers=headers | BEARER).status_code == 403, path
    for path in GETS:
        assert client.get(path, headers=headers).status_code == 403, path
    assert client.delete("/v1/calibration", headers=headers).status_code == 403
    assert client.options("/v1/demand", headers=headers).status_code == 403
    assert service.controller.answers == answers


def test_of_two_origins_both_must_be_ours(client: TestClient) -> None:
    headers = [("Origin", "http://localhost:8080"), ("Origin", "http://evil.example")]
    assert client.get("/v1/live", headers=headers).status_code == 403


def test_pages_of_the_service_itself_and_callers_without_a_page_are_let_in(client: TestClient) -> None:
    for headers in (
        {"Origin": "http://localhost:8080", "Sec-Fetch-Site": "same-origin"},
        {"Origin": "HTTP://LOCALHOST:8080"},
        {"Sec-Fetch-Site": "none"},
        {},
    ):
        assert client.get("/v1/live", headers=headers).status_code == 200, headers
    assert (
        client.get("/v1/live", headers={"Host": "localhost", "Origin": "http://localhost"}).status_code == 200
    )


def test_a_link_elsewhere_opens_the_pages_and_nothing_else(client: TestClient) -> None:
    link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    for path in ("/", "/docs"):
        assert client.get(path, headers=link).status_code == 200
        assert client.get(path, headers=link | {"Sec-Fetch-Dest": "iframe"}).status_code == 403
    for path in ("/v1/live", "/v1/health", "/metrics"):
        assert client.get(path, headers=link).status_code == 403
    form = {"Origin": "http://evil.example", "Content-Type": "application/json"}
    assert client.post("/v1/demand", content=b"{}", headers=link | form).status_code == 403


OWN_HOSTS = (
    "localhost", "LocalHost:8080", "localhost.", "127.0.0.1", "127.0.0.1:9000", "127.0.0.1.:80",
    "[::1]", "[::1]:8080", "[0:0:0:0:0:0:0:1]:1",
)  # fmt: skip
OTHER_HOSTS = (
    "evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "10.0.0.5",
    "[::2]", "::1", "localhost:port", "localhost:8080:8080", "user@localhost", "localhost/v1/health?",
    "localhost, evil.example", "", " ", "[localhost]", "localhost..",
)  # fmt: skip


@pytest.mark.parametrize("host", OWN_HOSTS)
def test_every_spelling_of_the_own_name_is_answered(client: TestClient, host: str) -> None:
    assert client.get("/v1/health", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("host", OTHER_HOSTS)
def test_names_of_others_are_answered_on_no_path_and_the_way_out_is_said(
    client: TestClient, host: str
) -> None:
    for path in GETS:
        answer = client.get(path, headers={"Host": host})
        assert answer.status_code == 421
        assert "--allowed-host NAME" in answer.json()["detail"]
    for path in POSTS:
        assert client.post(path, json=GOOD, headers={"Host": host}).status_code == 421


def test_a_name_does_not_make_another_path_of_it(closed: TestClient) -> None:
    """The path is the one that was asked for, whatever ``Host`` would make of the address."""
    for host in ("localhost/v1/health?", "localhost/v1/health#"):
        assert closed.get("/v1/live", headers={"Host": host}).status_code == 421
    for path in ("/v1/health/../live", "//v1/health", "/v1/health/", "/v1/live?/v1/health", "/v1%2Fhealth/x"):
        assert closed.get(path, follow_redirects=False).status_code == 401, path


def test_a_service_for_others_goes_by_its_address_its_name_and_those_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "Bess-PC")
    for host in ("0.0.0.0", "::", "10.0.0.5", "plant.example"):
        names = Names(host)
        for own in (
            host if ":" not in host else f"[{host}]",
            "192.168.7.7:8080",
            "bess-pc:8080",
            "localhost",
        ):
            assert names.answers(own), own
        for other in ("evil.example", "bess-pc.evil.example", "", None):
            assert not names.answers(other)
    # A service behind a proxy that leaves Host as it is, or puts the service's own address there.
    names = Names("127.0.0.1", ["bess.example", "Panel.example.:8443"])
    for host in ("bess.example", "panel.example", "panel.example:8443", "127.0.0.1:8080"):
        assert names.answers(host)
    for host, origin in (
        ("bess.example", "https://bess.example"),
        ("127.0.0.1:8080", "https://bess.example"),
        ("127.0.0.1:8080", "https://panel.example:8443"),
    ):
        assert names.is_own_page(host, [origin], ["same-origin"])
    for origin in ("https://bess.example:3000", "https://panel.example", "http://localhost:3000"):
        assert not names.is_own_page("127.0.0.1:8080", [origin], [])
    assert not Names("127.0.0.1").answers("bess-pc")


def test_an_allowed_name_that_is_none_is_refused_at_the_start() -> None:
    for text in ("http://plant.example", "plant.example/", "*", ""):
        with pytest.raises(InputError, match=r"--allowed-host .*NAME or NAME:PORT"):
            Names("127.0.0.1", [text])


def test_nobody_gets_in_without_the_token(closed: TestClient) -> None:
    for path in ("/", "/metrics", "/v1/live", "/openapi.json", "/docs"):
        assert closed.get(path).status_code == 401
        assert closed.get(path, headers=BEARER).status_code == 200
    assert closed.post("/v1/split", json=GOOD).status_code == 401
    wrong = {"Authorization": f"Bearer {TOKEN}x"}
    assert closed.post("/v1/split", json=GOOD, headers=wrong).status_code == 401
    assert closed.get("/v1/health").status_code == 200


def test_only_this_machine_is_listened_to_without_a_token() -> None:
    for host in ("127.0.0.1", "::1", "localhost"):
        check_token(host, None, drives=False)
    for host in ("0.0.0.0", "::", "10.0.0.1", "plant.example"):
        check_token(host, TOKEN, drives=True)
        with pytest.raises(InputError, match="--token-file"):
            check_token(host, None, drives=False)


def test_a_plant_is_driven_with_a_token_only(tmp_path: Path) -> None:
    for plant in ("openems=http://x:owner@127.0.0.1:1", "sunspec=127.0.0.1:1"):
        line = refused("serve", "case1", "--plant", plant, folder=tmp_path)
        assert line.startswith("bess: --plant: ") and "--token-file FILE" in line and "--shadow" in line
    check_token("127.0.0.1", None, drives=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("host", ["a..b", "plant.invalid"])
def test_a_host_that_is_no_name_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, host: str
) -> None:
    monkeypatch.setattr("bess.edge.serve.run._log_to_standard_error", lambda: None)
    token_file = tmp_path / "token"
    token_file.write_text(TOKEN)
    line = refused("serve", "case1", "--host", host, "--token-file", str(token_file), folder=tmp_path)
    assert line.startswith(f"bess: --host {host}: is not an address of this machine (")


def test_a_token_is_a_line_that_is_long_enough(tmp_path: Path) -> None:
    path = tmp_path / "token"
    for content in (b"", b"short\n", b"two words of some length\n", b"\xff" * 20):
        path.write_bytes(content)
        with pytest.raises(InputError, match="--token-file"):
            read_token(path)
    with pytest.raises(InputError, match="--token-file"):
        read_token(tmp_path / "none")
    path.write_text(TOKEN + "\n")
    assert read_token(path) == TOKEN
    assert is_allowed(TOKEN, f"Bearer {TOKEN}")
    assert not is_allowed(TOKEN, TOKEN)
    assert not is_allowed(TOKEN, None)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such bits")
@pytest.mark.parametrize(
    ("mode", "is_exposed"), [(0o600, False), (0o640, False), (0o644, True), (0o602, True)]
)
def test_a_token_file_of_everybody_is_warned_of(tmp_path: Path, mode: int, is_exposed: bool) -> None:
    path = tmp_path / "token"
    path.write_text(TOKEN)
    path.chmod(mode)
    assert bool(exposure(path)) == is_exposed
    assert not is_exposed or exposure(path).endswith(f"run chmod 600 {path}")


def test_a_rate_lets_bursts_pass_and_no_more() -> None:
    now = [0.0]
    rate = Rate(10.0, lambda: now[0])
    assert sum(rate.take() for _ in range(100)) == 20
    now[0] = 1.0
    assert sum(rate.take() for _ in range(100)) == 10


def test_those_who_only_look_at_health_take_nothing_from_the_holder_of_the_token(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [0.0]
    monkeypatch.setattr(Rate.__init__, "__defaults__", (lambda: now_s[0],))
    closed = TestClient(build_app(service, TOKEN), base_url="http://localhost")

    def statuses(n: int, path: str, **others: Any) -> set[int]:
        return {closed.get(path, **others).status_code for _ in range(n)}

    assert statuses(400, "/v1/health") == {200, 429}
    assert statuses(400, "/v1/live") == {401}
    assert statuses(10, "/v1/live", headers=BEARER) == {200}  # two seconds of 5 requests
    assert statuses(10, "/v1/health", headers=BEARER) == {429}
    now_s[0] = 1.0
    assert statuses(5, "/v1/health", headers=BEARER) == {200}
    assert statuses(50, "/v1/health") == {200}
