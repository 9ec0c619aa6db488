"""A plant of your own: cell tables and an inverter data sheet into a system file, and a run with it.

python examples/own_cell_and_inverter.py [OUT]
"""

import sys
from pathlib import Path

import tomli_w

import bess

# Efficiency over load, in per cent, as on a data sheet; the power is that on the DC side.
LOAD_PCT = [5, 10, 20, 30, 50, 75, 100]
DISCHARGE_PCT = [88.0, 93.4, 96.3, 97.2, 97.8, 97.9, 97.7]
CHARGE_PCT = [87.5, 93.0, 96.1, 97.0, 97.7, 97.8, 97.6]

CELL = {
    "cell_capacity_ah": 100.0,
    "cell_mass_kg": 1.9,
    "cells_series": 200,
    "cells_parallel": 4,
    "ocv_v": {
        "soc": [0.0, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0],
        "charge": [3.12, 3.36, 3.45, 3.54, 3.64, 3.75, 3.93, 4.16],
        "discharge": [3.09, 3.34, 3.43, 3.52, 3.62, 3.73, 3.91, 4.14],
    },
    "resistance_temperature": {
        "temperature_c": [10.0, 25.0, 40.0, 60.0],
        "resistance_mohm": [1.9, 1.2, 0.85, 0.6],
    },
    "resistance_soc": {"soc": [0.0, 0.03, 0.1], "resistance_mohm": [9.0, 3.0, 1.2]},  # meets 1.2 at 25 degC
}


def write_system(path: Path) -> bess.System:
    """Start from the reference system, change what differs, write the file, and read it back."""
    table = bess.inverter_from_efficiency(
        LOAD_PCT,
        charge=CHARGE_PCT,
        discharge=DISCHARGE_PCT,
        nominal_kw=110.0,
        power_unit="percent",
        axis="dc",
    )
    document = bess.System.reference(n_strings=2).document
    document["inverter"] = table.section()
    document["battery"] |= CELL
    document["string"] = [{}, {"battery": {"r_scale": 1.4, "cell_capacity_ah": 85.0}}]  # the second is aged
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(document), encoding="utf-8")
    return bess.load_system(path)


def main(out: Path, days: float = 1.0) -> bess.Result:
    """Write ``out/my-plant.toml`` and run ``days`` of case 1 with it."""
    system = write_system(out / "my-plant.toml")
    print(system)
    study = bess.load_study("case1", {"system.file": str(out / "my-plant.toml"), "run.days": days})
    result = bess.run(study, out=out / "run")
    throughput = abs(result.dataset["delivered_kw"]).sum("time").values * 0.25
    print(f"energy through each string: {throughput.round(0)} kWh")
    print(f"system efficiency: {result.kpis['system_efficiency_pct']:.2f} %")
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/own-plant"))
