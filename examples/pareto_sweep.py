"""A Pareto front of inverter against battery losses: scenarios side by side on Dask, front and knee.

    python examples/pareto_sweep.py [OUT]

``bess sweep pareto`` runs 21 weights over 48 h; here it is five over one day.
"""

import sys
from pathlib import Path

import bess
from bess.simulation.analysis import pareto

STUDY = """
title = "Weights of inverter against battery losses"
[demand]
file = "two-cycle-48h"
repeat = true
[run]
days = {days}
[[sweep]]
simplex = ["policy.objectives.inverter", "policy.objectives.battery"]
divisions = {divisions}
"""
AXES = ["inverter_efficiency_pct", "battery_efficiency_pct"]


def main(out: Path, days: float = 1.0, divisions: int = 4, workers: int = 2) -> bess.SweepResult:
    """Sweep the weights into ``out``; calling it again skips what is done."""
    out.mkdir(parents=True, exist_ok=True)
    study_file = out / "weights.toml"
    study_file.write_text(STUDY.format(days=days, divisions=divisions), encoding="utf-8")
    sweep = bess.run_sweep(study_file, out / "runs", workers=workers)
    if sweep.failed:
        print(f"failed: {sweep.failed}")
    table = sweep.table().query("status == 'done'")
    points = table[AXES].to_numpy()
    table["on_front"] = pareto.non_dominated(points, ["max", "max"])
    knee = pareto.knee_point(points, ["max", "max"])
    print(table[["name", *AXES, "system_efficiency_pct", "on_front"]].to_string(index=False))
    print(f"knee: {table['name'].iloc[knee]}")
    bess.write_report(sweep.directory)
    return sweep


if __name__ == "__main__":  # workers are processes that import this file
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/pareto-sweep"))
