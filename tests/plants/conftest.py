"""A simulated plant whose clock the tests move, behind an OpenEMS edge or SunSpec devices on the loopback."""

from collections.abc import Callable, Iterator

import pytest
from plant_partners import ManualClock, N, Partner, Watched

import bess
from bess.plants import PlantLink, connect
from bess.plants.simulated import SimulatedPlant
from bess.plants.simulated_openems import SimulatedEdge
from bess.plants.simulated_sunspec import SimulatedDevices


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
def _no_password_from_outside(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("BESS_PLANT_USER", raising=False)
    monkeypatch.delenv("BESS_PLANT_PASSWORD", raising=False)
    yield


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
