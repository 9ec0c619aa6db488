"""Write the tables of ``foresight.md`` on plans and weeks: ``python docs/make_plans.py``, ten minutes of CPU.

The demand is the bundled two-cycle day, in proportion to the strings; cost is 3 x undelivered + losses [kWh].
"""

import re
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tables import markdown_table

import bess
from bess.dispatch.profile import bundled_profile
from bess.study import expand

DOCS = Path(__file__).parent
STEPS_PER_DAY = 96
WEEK, MONTH = 7, 28
"""Days."""
LENGTHS = (7, 8, 9, 10, MONTH)
LOWER_LIMITS = (0.0, 0.05, 0.08)
SEED, DRAWN = 20261125, 5
SIZES = (2, 4, 8, 32, 256, 1000)
RUN_SIZES = (2, 8, 16, 32, 100, 256, 1000)
PLANTS: dict[str, tuple[tuple[int, ...], float, float, int]] = {
    "rated demand": (SIZES, 1.0, 25.0, 1),
    "38 °C": ((2, 8), 1.0, 38.0, 1),
    "1.54 times the demand": ((2,), 1.54, 25.0, 1),
    "seven days": ((2,), 1.0, 25.0, WEEK),
}
"""Numbers of strings, demand relative to rated, ambient temperature [degC] and days of single plans."""

Array = NDArray[np.float64]


def main() -> None:
    """Write the tables."""
    for table in (soc_limits, plan_lengths, plan_gaps, plan_sizes):
        path = DOCS / "_cases" / f"{table.__name__.replace('_', '-')}.md"
        path.write_text(markdown_table(table()), encoding="utf-8")
        print(path.read_text(encoding="utf-8"), flush=True)


def plan_gaps() -> list[list[str]]:
    """Optimality gaps of plans, without start cost."""
    rows = [["plant", "strings", "cost (kWh)", "search bound (kWh)", "search gap", "rigorous gap", "CPU s"]]
    objectives = bess.Objectives.energy(start_kwh=0.0)
    for name, (sizes, scale, ambient_c, days) in PLANTS.items():
        for n in sizes:
            system = bess.System.reference(n)
            started = time.process_time()
            plan = bess.plan_power(
                system, begin(n, ambient_c), scale * demand_kw(n, days), objectives, ambient_c=ambient_c
            )
            cpu_s = time.process_time() - started
            numbers = (plan.cost, plan.cost * (1.0 - plan.search_gap))
            percent = (f"{100.0 * gap:.1f} %" for gap in (plan.search_gap, plan.gap))
            rows.append([name, f"{n:,}", *(f"{x:,.1f}" for x in numbers), *percent, f"{cpu_s:.1f}"])
    return rows


def plan_sizes() -> list[list[str]]:
    """Share of the demand that closed loops of two days lose, each in a process of its own."""
    rows = [
        [
            "strings",
            "undelivered + losses, share of the demand: `mpc`",
            "`soc`",
            "CPU of the run with `mpc` (s)",
            "peak memory (MB)",
        ]
    ]
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        for n in RUN_SIZES:
            (lost, cpu_s, peak_mb), (by_soc, *_) = pool.map(lost_pct, (n, n), ("mpc", "soc"))
            rows.append([f"{n:,}", f"{lost:.2f} %", f"{by_soc:.2f} %", f"{cpu_s:.1f}", f"{peak_mb:.0f}"])
    return rows


def lost_pct(n_strings: int, policy: str) -> tuple[float, float, float]:
    """Energy lost [% of the demand], CPU time of the run [s] and peak memory of this process [MB]."""
    soc = np.random.default_rng(n_strings).uniform(0.35, 0.65, n_strings)
    values = {
        "run.days": 2,
        "policy.name": policy,
        "demand.scale": n_strings / 2,
        "system.n_strings": n_strings,
        "system.initial_soc": (soc + 0.5 - soc.mean()).tolist(),
    }
    study = expand(bess.load_study("arena"))["seven-days"].with_values(values)
    started = time.process_time()
    kpis = bess.run(study, progress=False).kpis
    cpu_s = time.process_time() - started
    lost = 100.0 * kpis["lost_kwh"] / kpis["demand_kwh"]
    # `getrusage` would give the peak of the parent, from which a process is forked, if that is higher.
    peak_kb = re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text(encoding="utf-8"))
    return lost, cpu_s, float(peak_kb[1]) / 1e3 if peak_kb else float("nan")


def plan_lengths() -> list[list[str]]:
    """What a week costs, and what it leaves in store, in plans that end with the demand."""
    rows = [
        ["length of the plan", "cost of seven days (kWh)", "energy in store after them", "whole cost (kWh)"]
    ]
    system, state = bess.System.reference(2), begin(2, 25.0)
    for days in LENGTHS:
        plan = bess.plan_power(system, state, demand_kw(2, days))
        run = bess.PlantEnsemble(system, [state]).run(plan.request_kw.T[None], 900.0)
        cost = weighted_kw(run).sum(axis=(0, 2)).cumsum() / 4.0
        week = WEEK * STEPS_PER_DAY - 1
        store = f"{100.0 * run.soc[0, week].mean():.0f} %"
        rows.append([f"{days} days", f"{cost[week]:,.0f}", store, f"{cost[-1]:,.0f}"])
    return rows


def begin(n_strings: int, temperature_c: float) -> bess.State:
    """Half full strings."""
    return bess.State([0.5] * n_strings, [temperature_c] * n_strings)


def demand_kw(n_strings: int, days: int) -> Array:
    """Rated demand of so many strings."""
    return n_strings / 2 * np.resize(bundled_profile("two-cycle-48h"), days * STEPS_PER_DAY)


def soc_limits() -> list[list[str]]:
    """Costs of runs with different lower limits of SOC."""
    rows = [["plant", f"`mpc`, first {WEEK} of {MONTH} days", f"`mpc`, {MONTH} days", f"`soc`, {MONTH} days"]]
    random = np.random.default_rng(SEED)
    drawn = [
        (int(random.integers(2, 5)), round(random.uniform(0.45, 1.25), 2), int(random.integers(10, 35)))
        for _ in range(DRAWN)
    ]
    for n, scale, ambient_c in [(2, 1.0, 25), *drawn]:
        runs = [
            {
                "run.days": MONTH,
                "policy.name": policy,
                "demand.scale": n / 2 * scale,
                "system.n_strings": n,
                "system.ambient_c": float(ambient_c),
                "system.initial_temperature_c": float(ambient_c),
                "system.parameters": {"battery": {"soc_min": soc_min}},
            }
            for policy in ("mpc", "soc")
            for soc_min in LOWER_LIMITS
        ]
        with ProcessPoolExecutor() as pool:
            week, month = np.array(list(pool.map(costs_kwh, runs))).T.reshape(2, 2, -1)
        cells = (" / ".join(f"{cost:,.0f}" for cost in costs) for costs in (week[0], *month))
        rows.append([f"{n} strings, scale {scale:g}, {ambient_c} °C", *cells])
    return rows


def costs_kwh(values: dict[str, Any]) -> tuple[float, float]:
    """Cost of the first week, and of the whole run."""
    study = expand(bess.load_study("arena"))["seven-days"].with_values(values)
    record = bess.run(study, progress=False).dataset
    cost = weighted_kw(record).sum("string").cumsum("time").values / 4.0
    return float(cost[WEEK * STEPS_PER_DAY - 1]), float(cost[-1])


def weighted_kw(flows: Any) -> Any:
    """Undelivered power three times, and losses, of a plant's flows or a record."""
    shortfall_kw = flows.availability_loss_kw + flows.derating_loss_kw
    return 3.0 * shortfall_kw + flows.inverter_loss_kw + flows.battery_loss_kw


if __name__ == "__main__":
    main()
