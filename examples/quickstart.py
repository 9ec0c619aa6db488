"""One power split, half a day in closed loop, and the report of it.

python examples/quickstart.py [OUT]
"""

import sys
from pathlib import Path

import bess


def main(out: Path, days: float = 0.5) -> bess.Result:
    """Split one horizon, run ``days`` of case 1 into the new folder ``out``, write its report."""
    system = bess.System.reference(n_strings=2)
    state = bess.State(soc=[0.7, 0.4], temperature_c=[25.0, 38.0])
    split = bess.split_power(system, state, demand_kw=[78.0] * 8)
    print(f"{split.status}; set-points of the next 15 min: {split.request_kw[:, 0].round(1)} kW")
    print(f"{100 * split.gap:.2f} % above a proven bound, {1e3 * split.solve_time_s:.0f} ms")

    result = bess.run(bess.load_study("case1", {"run.days": days}), out=out)
    for name in ("availability_pct", "system_efficiency_pct", "peak_mean_temperature_c"):
        print(f"{name:24} {result.kpis[name]:7.2f}")
    print(bess.write_report(out))
    return result


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/quickstart"))
