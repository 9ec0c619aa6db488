"""Simulated plant on the local machine, optionally with a service that controls it."""

from __future__ import annotations

import os
import shlex
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

from bess.edge.plant_io.simulated import SimulatedPlant
from bess.optional_dependencies import extra
from bess.study import Study
from bess.study.demands import ProfileDemand
from bess.study.plant_choice import build_system

PlantKind = Literal["openems", "sunspec"]
PORTS: Final[dict[PlantKind, int]] = {"openems": 8084, "sunspec": 5020}
PAGE_PORT: Final = 8080
STEP_S: Final = 1.0
"""Default control step of the service: short, for a lively page."""
_SHOWN_EVERY_S: Final = 10.0
_PAGE_AFTER_S: Final = 2.0


def demo_plant(study: Study, given: str, kind: PlantKind, port: int | None, speed: float) -> None:
    """Serve the plant of a study on the loopback interface and print its state every few seconds.

    ``given`` is the study as named on the command line, for the command that controls the plant.
    """
    plant = _plant(study, speed)
    with _listening(plant, kind, port) as address:
        print(f"Simulated plant with {plant.n_strings} strings at {speed:g} times real time. Control it with")
        print(f"  bess serve {shlex.quote(given)} --token-file FILE --plant {address}")
        print("Stop it with Ctrl-C.", flush=True)
        try:
            while True:
                time.sleep(_SHOWN_EVERY_S)
                print(_line(plant), flush=True)
        except KeyboardInterrupt:
            print("The plant has stopped.")


def serve_demo(study: Study, kind: PlantKind, port: int | None, speed: float, folder: Path) -> None:
    """Serve the plant of a study and control it in the same process; open the live page."""
    with extra("plant", "a simulated plant"):
        from bess.edge.serve.run import serve

    if study.service.control_step_s is None:
        study = study.with_values({"service.control_step_s": STEP_S})
    if isinstance(study.demand, ProfileDemand):
        study = study.with_values({"service.follow_profile": True})
    page_port = _free_port(PAGE_PORT)
    page = f"http://127.0.0.1:{page_port}/"
    with _listening(_plant(study, speed), kind, port) as address:
        print(f"Simulated plant at {speed:g} times real time, with a controller: open {page}")
        print(f"Stop both with Ctrl-C; then create the report with bess report {folder}.", flush=True)
        if sys.stdout.isatty() and (os.environ.get("DISPLAY") or sys.platform in ("win32", "darwin")):
            opening = threading.Timer(_PAGE_AFTER_S, webbrowser.open, [page])
            opening.daemon = True
            opening.start()
        serve(study, port=page_port, state=folder, plant=address, simulated=True)


def _plant(study: Study, speed: float) -> SimulatedPlant:
    return SimulatedPlant(build_system(study.system, study.run, study.wear), speed=speed)


@contextmanager
def _listening(plant: SimulatedPlant, kind: PlantKind, port: int | None) -> Iterator[str]:
    """Yield the address for ``--plant``."""
    with extra("plant", "a simulated plant"):
        if kind == "openems":
            from bess.edge.plant_io.simulated_openems import SimulatedEdge as Partner
        else:
            from bess.edge.plant_io.simulated_sunspec import SimulatedDevices as Partner  # type: ignore[assignment]
    with Partner(plant, port=PORTS[kind] if port is None else port) as partner:
        yield partner.address


def _free_port(wanted: int) -> int:
    """Return the port if it is free, otherwise any free port."""
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", wanted))
        except OSError:
            probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _line(plant: SimulatedPlant) -> str:
    readings = plant.truth()
    power = ", ".join(f"{reading.power_kw:.1f}" for reading in readings)
    soc = ", ".join(f"{100.0 * reading.soc:.1f}" for reading in readings)
    hottest = max(reading.hottest_c for reading in readings)
    total = sum(reading.power_kw for reading in readings)
    return f"{time.strftime('%H:%M:%S')}  {power} kW (total {total:.1f})  SOC {soc} %  up to {hottest:.1f} °C"
