"""SimSES 2.1.1, two strings, no control: lumped thermal at 15 min, or its container model at 10 s."""

import json
import resource
import sys

import simses
from simses.battery.battery import Battery
from simses.converter.converter import Converter
from simses.model.cell.samsung94Ah_nmc import Samsung94AhNMC
from simses.model.converter.sinamics import SinamicsS120
from simses.model.thermal.containers import FortyFtContainer
from simses.thermal.ambient import AmbientThermalModel
from simses.thermal.container import ConstantCopHvac, ContainerThermalModel, ThermostatStrategy
from two_cycles import series

STRINGS = 2


def main(days: float, thermal: str) -> None:
    """Run ``days`` days and print CPU seconds, scaled to a string-year (the cost of a step does not vary)."""
    step_s = 10.0 if thermal == "container" else 900.0
    start = {"start_soc": 0.5, "start_T": 25.0}
    batteries = [Battery(Samsung94AhNMC(), (192, 4), dict(start)) for _ in range(STRINGS)]
    converters = [Converter(SinamicsS120(use_discharging_curve=True), 92e3, b) for b in batteries]
    if thermal == "container":
        room = ContainerThermalModel(
            FortyFtContainer(), 25.0, 25.0, ConstantCopHvac(), ThermostatStrategy(25.0, 10e3)
        )
    else:
        room = AmbientThermalModel(25.0)
    for battery in batteries:
        room.add_component(battery)
    powers = series(step_s, days, -39e3)  # SimSES counts charging positive
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    for power in powers:
        for converter in converters:
            converter.step(power, step_s)
        room.step(step_s)
    cpu_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime - before
    print(
        json.dumps(
            {
                "version": simses.__version__,
                "string_year_cpu_s": cpu_s * 365.0 / days / STRINGS,
                "simulated_days": days,
                "final_soc": batteries[0].state.soc,
            }
        )
    )


if __name__ == "__main__":
    main(float(sys.argv[1]), sys.argv[2])
