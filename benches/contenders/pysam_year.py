"""PySAM BatteryStateful (NREL SAM's battery, lumped thermal model) at 15 min or at 10 s, no control."""

import json
import resource
import sys

import PySAM
import PySAM.BatteryStateful as Battery
from two_cycles import series


def main(days: float, step_s: float) -> None:
    """Run ``days`` days of one battery and print CPU seconds, scaled to a string-year."""
    battery = Battery.default("NMCGraphite")
    battery.value("nominal_energy", 265.7)
    battery.value("nominal_voltage", 706.6)
    battery.value("mass", 1613.0)
    battery.value("surface_area", 12.3)
    battery.value("initial_SOC", 50.0)
    battery.value("minimum_SOC", 0.0)
    battery.value("maximum_SOC", 100.0)
    battery.value("control_mode", 1.0)  # power
    battery.value("dt_hr", step_s / 3600.0)
    battery.value("input_power", 0.0)
    battery.setup()
    powers = series(step_s, days, 39.0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    for power in powers:
        battery.value("input_power", power)
        battery.execute(0)
    cpu_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime - before
    print(
        json.dumps(
            {
                "version": PySAM.__version__,
                "string_year_cpu_s": cpu_s * 365.0 / days,
                "simulated_days": days,
                "final_soc": battery.StatePack.SOC / 100.0,
            }
        )
    )


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]))
