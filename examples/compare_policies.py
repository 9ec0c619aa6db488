"""The optimiser against four simple rules on the demand of case 1, by the same plant.

    python examples/compare_policies.py [OUT]

Two days take about a minute, nearly all of it for the optimiser. ``bess run policies`` does the same.
"""

import sys
from pathlib import Path

import bess
from bess.report import save_figure
from bess.report.figures import kpi_bars

POLICIES = ("mpc", "equal", "priority", "soc", "temperature")
SHOWN = (
    ("availability_pct", "avail. %"),
    ("derating_efficiency_pct", "derat. %"),
    ("inverter_efficiency_pct", "inv. %"),
    ("battery_efficiency_pct", "bat. %"),
    ("system_efficiency_pct", "system %"),
    ("delivered_kwh", "kWh"),
    ("peak_mean_temperature_c", "peak degC"),
)


def main(out: Path, days: float = 2.0) -> dict[str, dict[str, float]]:
    """Run every policy into a sub-folder of ``out`` and return their KPIs."""
    kpis = {}
    for policy in POLICIES:
        study = bess.load_study("case1", {"name": policy, "policy.name": policy, "run.days": days})
        kpis[policy] = bess.run(study, out=out / policy).kpis
    print(f"{'':12}" + "".join(f"{title:>11}" for _, title in SHOWN))
    for policy, values in kpis.items():
        print(f"{policy:12}" + "".join(f"{values[key]:11.2f}" for key, _ in SHOWN))
    save_figure(kpi_bars(kpis), out / "policies.svg")
    return kpis


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/compare-policies"))
