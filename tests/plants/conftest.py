"""A simulated plant whose clock the tests move, behind an OpenEMS edge or SunSpec devices on the loopback."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

import bess
from bess.plants.simulated import SimulatedPlant

N = 3


@dataclass
class ManualClock:
    """Stands still until told."""

    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class Watched:
    """A plant that remembers every set-point that reached it, in kW."""

    plant: SimulatedPlant
    clock: ManualClock
    asked: list[tuple[int, float]] = field(default_factory=list)

    def power_kw(self) -> np.ndarray:
        return np.array([reading.power_kw for reading in self.plant.truth()])


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
