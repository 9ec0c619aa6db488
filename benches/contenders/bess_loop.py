"""Closed loop of this package: two strings, plant at 10 s; two-cycle profile or real prices.

python bess_loop.py DAYS planned|certified [PRICES]
"""

import json
import resource
import sys
import tempfile

import bess

START = "2024-05-01T00:00:00Z"  # of a run on prices
POLICY = {
    "planned": {"policy.mode": "plan"},
    "certified": {"policy.mode": "certified", "policy.horizon_steps": 8},
}


def main(days: float, kind: str, prices: str = "") -> None:
    """Run ``days`` days, files and all, and print CPU seconds, scaled to a year of the plant."""
    values = {"demand.prices": prices, "run.start": START} if prices else {}
    if kind == "certified" or not prices:
        values["policy.objectives.kind"] = "paper" if kind == "certified" else "energy"
    study = bess.load_study("arbitrage-2024" if prices else "case1", {**values, **POLICY[kind]})
    bess.run(study.with_values({"run.days": 1.0 / 96.0}), progress=False)  # imports and the first compilation
    study = study.with_values({"run.days": days})
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        result = bess.run(study, out=f"{folder}/run", progress=False)
        usage = resource.getrusage(resource.RUSAGE_SELF)
    kpis = result.kpis
    print(
        json.dumps(
            {
                "version": bess.__version__,
                "year_cpu_s": (usage.ru_utime - before) * 365.0 / days,
                "simulated_days": days,
                "solves_per_day": kpis["solver_steps"] / days,
                "nodes_mean": float(result.dataset["solver_nodes"].mean()),
                "search_gap_median": kpis.get("solver_search_gap_median"),
                "fallback_steps": kpis["fallback_steps"],
                "peak_memory_mb": usage.ru_maxrss / 1024.0,
            }
        )
    )


if __name__ == "__main__":
    main(float(sys.argv[1]), *sys.argv[2:])
