"""A simulated plant whose clock the tests move, behind an OpenEMS edge or SunSpec devices on the loopback."""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from plant_partners import STEP_S, Connecting, ManualClock, N, Partner, Rig, Watched

import bess
from bess.edge.plant_io import PlantLink, calls, connect
from bess.edge.plant_io.journal import Journal
from bess.edge.plant_io.simulated import SimulatedPlant
from bess.edge.plant_io.simulated_openems import SimulatedEdge
from bess.edge.plant_io.simulated_sunspec import SimulatedDevices
from bess.edge.serve.control_loop import ControlLoop, Demands
from bess.edge.serve.service import Service
from bess.study import Study
from patient import PATIENT


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    clock = ManualClock()
    plant = SimulatedPlant(bess.System.reference(n_strings=N), clock=clock)
    watched = Watched(plant, clock)
    real: Callable[[int, float, float], None] = plant.ask

    def ask(string: int, power_kw: float, lapses_at: float) -> None:
        watched.asked.append((string, power_kw))
        real(string, power_kw, lapses_at)

    monkeypatch.setattr(plant, "ask", ask)
    return watched


@pytest.fixture(autouse=True)
def _no_password_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BESS_PLANT_USER", raising=False)
    monkeypatch.delenv("BESS_PLANT_PASSWORD", raising=False)


@pytest.fixture(autouse=True)
def _a_busy_disk_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calls, "DISK_DELAY_S", 60.0)


@pytest.fixture(params=["openems", "sunspec"])
def partner(request: pytest.FixtureRequest, watched: Watched) -> Iterator[Partner]:
    kind = SimulatedEdge if request.param == "openems" else SimulatedDevices
    with kind(watched.plant) as partner:
        yield partner


@pytest.fixture
def connecting() -> Iterator[Callable[[str, int], PlantLink]]:
    """Connects, and closes the link when the test is over."""
    links = []

    def to(address: str, n_strings: int = N) -> PlantLink:
        links.append(connect(address, n_strings))
        return links[-1]

    yield to
    for link in links:
        link.close()


@pytest.fixture
def link(partner: Partner, connecting: Callable[[str, int], PlantLink]) -> PlantLink:
    return connecting(partner.address, N)


@pytest.fixture
def rig(
    partner: Partner,
    connecting: Connecting,
    watched: Watched,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Rig]:
    monkeypatch.setattr(calls, "CLOCK", watched.clock)
    study = Study.from_document(
        {
            "name": "matrix",
            "system": {"n_strings": N},
            "demand": {"file": "two-cycle-48h"},
            "policy": {"name": "soc"},
            "service": {"control_step_s": STEP_S, "frozen_readings": 3, "retry_after_s": 60.0},
        },
        "the fault matrix",
    ).with_values(PATIENT)
    service = Service(study, tmp_path / "state")
    clock = watched.clock
    began = datetime(2026, 11, 22, tzinfo=UTC).timestamp()
    monkeypatch.setattr(service, "clock", lambda: began + clock.now_s)
    demands = Demands(study, 900.0)
    journal = Journal(tmp_path / "state", service.controller.system, "matrix")
    link = connecting(partner.address)  # looks at the clock above
    cycle = ControlLoop(service, link, demands, journal, monotonic=clock)
    yield Rig(watched, partner, cycle, service, demands, clock, tmp_path / "state", monkeypatch)
    service.close()
    journal.close()
