"""A simulated plant on this machine, until it is told to stop."""

from __future__ import annotations

import time
from typing import Final

from bess.cli.app import PlantKind
from bess.extras import extra
from bess.plants.simulated import SimulatedPlant
from bess.study import Study
from bess.study.plant_choice import build_system

PORTS: Final = {PlantKind.OPENEMS: 8084, PlantKind.SUNSPEC: 5020}
_SHOWN_EVERY_S: Final = 10.0


def demo_plant(study: Study, kind: PlantKind, port: int | None, speed: float) -> None:
    """Serve the plant of a study on the loopback and say every few seconds what it does.

    Raises
    ------
    InputError
        For a port that is taken, a speed that is none, or a missing extra.
    """
    plant = SimulatedPlant(build_system(study.system, study.run, study.wear), speed=speed)
    with extra("plant", "a simulated plant"):
        if kind is PlantKind.OPENEMS:
            from bess.plants.simulated_openems import SimulatedEdge as Partner
        else:
            from bess.plants.simulated_sunspec import SimulatedDevices as Partner  # type: ignore[assignment]
    with Partner(plant, port=PORTS[kind] if port is None else port) as partner:
        print(
            f"A plant of {plant.n_strings} strings, {speed:g} times as fast as time, listens. Drive it with"
        )
        print(f"  bess serve {study.name} --plant {partner.address}")
        print("Ctrl-C ends it.", flush=True)
        try:
            while True:
                time.sleep(_SHOWN_EVERY_S)
                print(_line(plant), flush=True)
        except KeyboardInterrupt:
            print("The plant has stopped.")


def _line(plant: SimulatedPlant) -> str:
    readings = plant.truth()
    power = ", ".join(f"{reading.power_kw:.1f}" for reading in readings)
    soc = ", ".join(f"{100.0 * reading.soc:.1f}" for reading in readings)
    hottest = max(reading.hottest_c for reading in readings)
    total = sum(reading.power_kw for reading in readings)
    return (
        f"{time.strftime('%H:%M:%S')}  {power} kW ({total:.1f} in all)  SOC {soc} %  up to {hottest:.1f} °C"
    )
