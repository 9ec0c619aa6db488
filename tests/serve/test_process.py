"""The service as a process: under load, and killed."""

import asyncio
import json
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fastapi")

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

from service_load import Server, load

pytestmark = pytest.mark.process

BODY = {"demand_kw": 100.0, "strings": [{"soc": 0.6}, {"soc": 0.5}]}


def call(server: Server, path: str, body: object = None) -> dict:  # type: ignore[type-arg]
    data = None if body is None else json.dumps(body).encode()
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}{path}", data, timeout=10.0) as answer:
        return json.load(answer)  # type: ignore[no-any-return]


def test_under_load_no_sum_is_wrong_and_nobody_is_left_without_an_answer(tmp_path: Path) -> None:
    server = Server(tmp_path, 2)
    try:
        outcome = asyncio.run(load(server, 2, requests=600, at_once=20, malformed=0.05))
    finally:
        server.kill()
    assert sum(outcome.statuses.values()) == 600
    assert outcome.statuses.keys() == {200, 422}
    assert outcome.wrong_statuses == outcome.wrong_sums == 0
    assert outcome.rss_kb[-1] < 1.1 * outcome.rss_kb[1]


@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_a_service_that_is_killed_continues_with_its_plan_and_its_counters(
    tmp_path: Path, kills: int
) -> None:
    server = Server(tmp_path, 2)
    rng = np.random.default_rng(kills)
    answered, plan = 0, None
    try:
        for _ in range(kills):
            for _ in range(int(rng.integers(1, 6))):
                answer = call(server, "/v1/split", {**BODY, "demand_kw": float(rng.uniform(-150.0, 150.0))})
                assert not answer["fallback"]
                answered += 1
            plan = json.loads((tmp_path / "state" / "plan.json").read_bytes().split(b"\n")[1])
            server.kill()
            server = Server(tmp_path, 2)
            health = call(server, "/v1/health")
            assert health["answers"] == answered
            assert health["planned"]
            assert "cannot be used" not in (tmp_path / "log").read_text()
        call(server, "/v1/split", {**BODY, "demand_kw": answer["request_kw"][0] + answer["request_kw"][1]})
        after = json.loads((tmp_path / "state" / "plan.json").read_bytes().split(b"\n")[1])
    finally:
        server.kill()
    assert plan is not None
    # The same plan, or its successor if a quarter hour has passed meanwhile.
    assert after["plan"]["slot"] != plan["plan"]["slot"] or after["plan"] == plan["plan"]


def test_a_port_that_is_taken_is_bad_input(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    server = Server(tmp_path, 2)
    try:
        command = [sys.executable, "-m", "bess", "serve", "case1", "--port", str(server.port)]
        done = subprocess.run([*command, "--state", str(tmp_path / "other")], timeout=60.0, check=False)
    finally:
        server.kill()
    assert done.returncode == 2
    last = capfd.readouterr().err.splitlines()[-1]
    assert last.startswith(f"bess: --host 127.0.0.1 --port {server.port}: cannot be listened on")
