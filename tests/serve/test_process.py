"""The service as a process: under load, and killed."""

import asyncio
import json
import resource
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fastapi")

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

from patient import PATIENT
from service_load import Server, free_port, load

pytestmark = pytest.mark.process

PATIENT_OPTIONS = [word for key, value in PATIENT.items() for word in ("--set", f"{key}={value}")]
BODY = {"demand_kw": 100.0, "strings": [{"soc": 0.6}, {"soc": 0.5}]}


def call(port: int, path: str, body: object = None) -> dict:  # type: ignore[type-arg]
    data = None if body is None else json.dumps(body).encode()
    url, headers = f"http://127.0.0.1:{port}{path}", {"Content-Type": "application/json"}
    with urllib.request.urlopen(urllib.request.Request(url, data, headers), timeout=10.0) as answer:
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
    server = Server(tmp_path, 2, *PATIENT_OPTIONS)
    rng = np.random.default_rng(kills)
    answered, plan = 0, None
    try:
        for _ in range(kills):
            asked = int(rng.integers(1, 6))
            # The first plan is made beside the answers, and is kept with the next of them.
            while asked > 0 or not (tmp_path / "state" / "plan.json").exists():
                answer = call(
                    server.port, "/v1/split", {**BODY, "demand_kw": float(rng.uniform(-150.0, 150.0))}
                )
                assert not answer["fallback"]
                answered += 1
                assert answered < 20_000, "no plan came"
                asked -= 1
            plan = json.loads((tmp_path / "state" / "plan.json").read_bytes().split(b"\n")[1])
            server.kill()
            server = Server(tmp_path, 2, *PATIENT_OPTIONS)
            health = call(server.port, "/v1/health")
            assert health["answers"] == answered
            assert health["planned"]
            assert "cannot be used" not in (tmp_path / "log").read_text()
        call(
            server.port, "/v1/split", {**BODY, "demand_kw": answer["request_kw"][0] + answer["request_kw"][1]}
        )
        after = json.loads((tmp_path / "state" / "plan.json").read_bytes().split(b"\n")[1])
    finally:
        server.kill()
    assert plan is not None
    # The same plan, or its successor if a quarter hour has passed meanwhile.
    assert after["current"]["slot"] != plan["current"]["slot"] or after["current"] == plan["current"]


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


def test_a_service_that_is_refused_does_not_say_that_it_listens(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = [sys.executable, "-m", "bess", "serve", "case1", "--port", str(free_port())]
    command += ["--state", str(tmp_path), "--set", "system.parameters.control.step_min=5"]
    command += ["--set", "service.control_step_s=900"]
    done = subprocess.run(command, timeout=60.0, check=False)
    assert done.returncode == 2
    error = capfd.readouterr().err
    assert "must not exceed the plan's step" in error
    assert "listens at" not in error


def _serve(folder: Path, port: int, bytes_on_disk: int) -> subprocess.Popen[bytes]:
    """A service on a disk that takes no file of more than so many bytes."""
    command = [sys.executable, "-m", "bess", "serve", "policies", "--port", str(port)]
    command += ["--set", "policy.foresight_h=2", "--set", "policy.name=mpc"]
    command += ["--state", str(folder), *PATIENT_OPTIONS]
    limit = (bytes_on_disk, resource.RLIM_INFINITY)
    return subprocess.Popen(
        command,
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit),
    )


def _until_up(process: subprocess.Popen[bytes], port: int) -> None:
    while True:
        assert process.poll() is None
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            return
        except OSError:
            time.sleep(0.05)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of another process are Linux' own")
@pytest.mark.parametrize("before", ["new", "after a run"])
def test_a_service_on_a_full_disk_starts_controls_says_so_and_saves_once_there_is_room(
    tmp_path: Path, before: str
) -> None:
    folder = tmp_path / "state"
    port = free_port()
    answers = 0
    if before == "after a run":
        process = _serve(folder, port, resource.RLIM_INFINITY)
        _until_up(process, port)
        call(port, "/v1/split", BODY)
        answers = 1
        process.kill()
        process.wait()
    process = _serve(folder, port, 0)
    try:
        _until_up(process, port)
        assert call(port, "/v1/health")["status"] != "ok"
        for _ in range(3):
            answer = call(port, "/v1/split", BODY)
            assert sum(answer["request_kw"]) == pytest.approx(100.0)
            assert not answer["fallback"]
        health = call(port, "/v1/health")
        assert health["status"] != "ok"
        assert health["answers"] == answers + 3
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        call(port, "/v1/split", BODY)
        assert call(port, "/v1/health")["status"] == "ok"
    finally:
        process.kill()
        process.wait()
    saved = [json.loads(path.read_bytes().split(b"\n")[1]) for path in folder.glob("memory-*.json")]
    assert max(document["answers"] for document in saved) == answers + 4


def test_a_service_whose_log_nobody_reads_goes_on_and_ends_when_told(tmp_path: Path) -> None:
    port = free_port()
    command = [sys.executable, "-m", "bess", "serve", "policies", "--port", str(port)]
    command += ["--set", "policy.name=soc", "--state", str(tmp_path / "state"), *PATIENT_OPTIONS]
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    try:
        _until_up(process, port)
        for _ in range(600):  # a pipe holds 64 KiB, a line has some 200 bytes
            assert not call(port, "/v1/split", BODY)["fallback"]
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0
    finally:
        process.kill()
        process.communicate()
