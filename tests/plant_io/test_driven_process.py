"""A plant, and ``bess serve`` as a process of its own that drives it, is killed, and comes back."""

import signal
import socketserver
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from plant_partners import server

import bess
from bess.edge.plant_io.journal import open_journal
from bess.edge.plant_io.simulated import SimulatedPlant
from bess.edge.plant_io.simulated_openems import SimulatedEdge

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))
from service_load import free_port

pytestmark = pytest.mark.process

DEMAND_KW = 78.0
STUDY = """
[demand]
file = "profile.csv"
repeat = true

[policy]
name = "soc"

[service]
control_step_s = 1.0
follow_profile = true
"""


def _serve(address: str, *options: str) -> tuple[str, ...]:
    drive = ("serve", "study.toml", "--plant", address, "--token-file", "token")
    return (*drive, *options, "--port", str(free_port()))


@contextmanager
def _bess(
    folder: Path, *arguments: str, program: tuple[str, ...] = ("-m", "bess")
) -> Iterator[subprocess.Popen[bytes]]:
    with (folder / "log").open("ab") as log:
        command = [sys.executable, *program, *arguments]
        process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def _until(met: Callable[[], bool], within_s: float, log: Path) -> None:
    deadline = time.monotonic() + within_s
    while not met():
        assert time.monotonic() < deadline, log.read_text(encoding="utf-8")[-3000:]
        time.sleep(0.05)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = [
        f"2024-01-01T{hour:02}:{minute:02}:00Z,{DEMAND_KW}"
        for hour in range(24)
        for minute in (0, 15, 30, 45)
    ]
    (tmp_path / "profile.csv").write_text("time,power_kw\n" + "\n".join(rows) + "\n", encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    (tmp_path / "token").write_text(32 * "0", encoding="utf-8")
    return tmp_path


def test_a_service_that_is_killed_drives_on_when_it_is_back_and_lets_go_when_told(folder: Path) -> None:
    plant = SimulatedPlant(bess.System.reference(n_strings=2))

    def total_kw() -> float:
        return sum(reading.power_kw for reading in plant.truth())

    def held() -> list[object]:
        return [plant.holds(string) for string in range(2)]

    with SimulatedEdge(plant) as edge:
        serve = _serve(edge.address, "--state", "state")
        with _bess(folder, *serve) as process:
            _until(lambda: total_kw() == pytest.approx(DEMAND_KW, abs=0.01), 60.0, folder / "log")
            process.send_signal(signal.SIGKILL)
            process.wait(10)
        assert total_kw() == pytest.approx(DEMAND_KW, abs=0.01)  # the plant's watchdog has the last word
        for string in range(2):
            plant.take_back(string)
        with _bess(folder, *serve) as process:
            _until(lambda: total_kw() == pytest.approx(DEMAND_KW, abs=0.01), 60.0, folder / "log")
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0, (folder / "log").read_text(encoding="utf-8")[-3000:]
        assert held() == [None, None]
    journal = open_journal(folder / "state")
    assert journal["written_kw"].values[-1].sum() == pytest.approx(DEMAND_KW)
    assert (np.diff(journal["time"].values) > np.timedelta64(0)).all()


def test_one_command_shows_a_plant_and_the_service_that_drives_it(folder: Path) -> None:
    demo = ("demo-plant", "study.toml", "--serve", "--kind", "sunspec", "--port", str(free_port()))
    with _bess(folder, *demo) as process:
        log = folder / "log"
        journal = folder / "results" / "study-demo" / "journal"
        _until(lambda: any(path.stat().st_size for path in journal.glob("*.bin")), 60.0, log)
        time.sleep(3.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0, log.read_text(encoding="utf-8")[-3000:]
    assert "with a controller: open http://127.0.0.1:" in log.read_text(encoding="utf-8")
    did = open_journal(folder / "results" / "study-demo")["power_kw"].values
    assert did[-1].sum() == pytest.approx(DEMAND_KW, abs=0.1)


@pytest.mark.parametrize("piece", [b"HTTP/1.1 100 Continue\r\n\r\n", b""], ids=["trickle", "silence"])
def test_a_service_ends_within_10_s_whatever_its_edge_does(folder: Path, piece: bytes) -> None:
    asked = threading.Event()

    def trickle(request: socketserver.StreamRequestHandler, stop: threading.Event) -> None:
        request.rfile.readline()
        asked.set()
        while not stop.wait(0.2):
            request.wfile.write(piece)

    with (
        server(trickle) as port,
        _bess(folder, *_serve(f"openems=http://127.0.0.1:{port}?ess=ess0,ess1")) as process,
    ):
        assert asked.wait(60.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0, (folder / "log").read_text(encoding="utf-8")[-3000:]


SWALLOWED = """
import signal
import uvicorn
from bess.cli.main import main

run = uvicorn.Server.run

def interrupted(self, **options):
    try:
        signal.raise_signal(signal.SIGTERM)
    except BaseException:
        pass  # as in the callback of a weak reference, where Python prints an exception and goes on
    run(self, **options)

uvicorn.Server.run = interrupted
main()
"""


def test_a_signal_while_the_service_starts_is_not_lost(folder: Path) -> None:
    (folder / "swallowed.py").write_text(SWALLOWED, encoding="utf-8")
    plant = SimulatedPlant(bess.System.reference(n_strings=2))
    with (
        SimulatedEdge(plant) as edge,
        _bess(folder, *_serve(edge.address), program=("swallowed.py",)) as process,
    ):
        assert process.wait(60.0) == 0, (folder / "log").read_text(encoding="utf-8")[-3000:]
