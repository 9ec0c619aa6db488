"""What the tests of plants share: a clock that they move, and a plant that remembers its set-points."""

import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from bess.edge.plant_io import PlantLink
from bess.edge.plant_io.simulated import SimulatedPlant
from bess.edge.plant_io.simulated_openems import SimulatedEdge
from bess.edge.plant_io.simulated_sunspec import SimulatedDevices
from bess.edge.serve.control_loop import ControlLoop, Demands
from bess.edge.serve.service import Service

N = 3
"""Strings."""
STEP_S = 10.0
"""Control step."""
TOLERANCE_KW = 0.1

Connecting = Callable[..., PlantLink]
Partner = SimulatedEdge | SimulatedDevices
Behaviour = Callable[[socketserver.StreamRequestHandler, threading.Event], object]
"""What a server does with a connection, until told to stop."""


@contextmanager
def server(behave: Behaviour) -> Iterator[int]:
    """Yield the port of a server with this behaviour."""
    stop = threading.Event()

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            with suppress(OSError):  # the other end may have gone
                behave(self, stop)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as running:
        running.daemon_threads = True
        threading.Thread(target=running.serve_forever, args=(0.05,), daemon=True).start()
        yield running.server_address[1]
        stop.set()
        running.shutdown()


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


@dataclass
class Rig:
    """A service that drives a simulated plant, both by one clock that the test moves."""

    watched: Watched
    partner: Partner
    cycle: ControlLoop
    service: Service
    demands: Demands
    clock: ManualClock
    journal: Path
    monkeypatch: pytest.MonkeyPatch
    demand_kw: float = 0.0
    broken: list[str] = field(default_factory=list)

    def ask(self, demand_kw: float) -> None:
        self.demand_kw = demand_kw
        self.demands.post(demand_kw, 86_400.0, self.service.clock())

    def step(self, times: int = 1) -> None:
        """Let a control step pass; watch every set-point that reaches the plant."""
        for _ in range(times):
            self.watched.asked.clear()
            self.cycle.step()
            self._judge()
            self.clock.now_s += STEP_S

    def power_kw(self) -> float:
        return float(self.watched.power_kw().sum())

    def follows(self) -> bool:
        return abs(self.power_kw() - self.demand_kw) < TOLERANCE_KW

    def _judge(self) -> None:
        limits = self.watched.plant.truth()
        for string, kw in self.watched.asked:
            limit = limits[string].discharge_limit_kw if kw > 0.0 else limits[string].charge_limit_kw
            if kw * self.demand_kw < 0.0:
                self.broken.append(f"string {string} was sent {kw} kW against {self.demand_kw} kW")
            if abs(kw) > limit + 1e-9 and string not in self.watched.plant.faults.dead:
                self.broken.append(f"string {string} was sent {kw} kW beyond its {limit} kW")
        sent = dict(self.watched.asked)
        if len(sent) == N and not any(sent.values()):
            self.broken.append(f"all strings were sent zero while {self.demand_kw} kW were asked for")
