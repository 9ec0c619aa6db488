"""Rules and mpc in random scenarios with an outage of one string, announced or not (docs/foresight.md).

    python benches/outages.py --seed 1 --count 32 [--announced]

Cost is 3 x undelivered + losses [kWh] of four days of the two-cycle demand. The second cost adds one more day
under ``soc`` for every policy, from where its run ended: it counts what is left in store.
"""

from __future__ import annotations

import argparse
from datetime import datetime, timedelta

import numpy as np

import bess
from arena import RULES, WINS, measured, scenarios

DAYS = 4
POLICIES = (*RULES, "mpc")


def begin(study: bess.Study) -> datetime:
    """Start of a scenario; the arena gives one."""
    assert study.run.start is not None
    return study.run.start


def draw(random: np.random.Generator, announced: bool = False) -> bess.Study:
    """A plant of two to four strings, of which one is out of service for 4 to 30 hours."""
    n_strings = int(random.integers(2, 5))
    study = scenarios(["seven-days"])["seven-days"]
    start = begin(study) + timedelta(hours=int(random.integers(2, 60)))
    end = start + timedelta(hours=int(random.integers(4, 31)))
    return study.with_values(
        {
            "run.days": DAYS,
            "system.n_strings": n_strings,
            "system.initial_soc": random.uniform(0.25, 0.75, n_strings).round(2).tolist(),
            "system.ambient_c": float(random.integers(10, 33)),
            "demand.scale": round(float(random.uniform(0.5, 1.1)) * n_strings / 2, 2),
            "event": [
                {
                    "string": int(random.integers(n_strings)),
                    "start": start,
                    "end": end,
                    "announced": announced,
                }
            ],
        }
    )


def costs(study: bess.Study, policy: str) -> tuple[float, float]:
    """Cost of a run, and with one more day under ``soc`` [kWh]."""
    run, result = measured(study.with_values({"policy.name": policy}))
    last = result.dataset.isel(time=-1)
    after = study.with_values(
        {
            "policy.name": "soc",
            "run.start": begin(study) + timedelta(days=DAYS),
            "run.days": 1,
            "system.initial_soc": last["soc"].values.tolist(),
            "system.initial_temperature_c": last["temperature_c"].values.tolist(),
            "event": [],
        }
    )
    return run.cost_kwh, run.cost_kwh + measured(after)[0].cost_kwh


def main() -> None:
    """Draw, run and count."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--count", type=int, default=32)
    arguments.add_argument("--announced", action="store_true")
    chosen = arguments.parse_args()
    random = np.random.default_rng(chosen.seed)
    against = []
    for index in range(chosen.count):
        study = draw(random, chosen.announced)
        table = np.array([costs(study, policy) for policy in POLICIES])
        ahead = table[-1] / table[:-1].min(axis=0) - 1.0
        against.append(ahead)
        best = RULES[int(table[:-1, 0].argmin())]
        print(f"{index:3d} {best:12s} {100 * ahead[0]:+7.1f} % {100 * ahead[1]:+7.1f} %", flush=True)
    values = np.array(against)
    for name, column in zip(("four days", "with one more day under soc"), values.T, strict=True):
        print(
            f"{name}: mpc against the best rule {100 * column.mean():+.1f} % in the mean, "
            f"{100 * column.max():+.1f} % at worst; a rule ahead in {(column > WINS).sum()} of {column.size}"
        )


if __name__ == "__main__":
    main()
