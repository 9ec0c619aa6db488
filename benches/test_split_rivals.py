"""The power split beside Gurobi on the same equations, in one run.

``python -m pytest benches/test_split_rivals.py -o addopts= -s``. Gurobi's wheel carries a size-limited
licence: 200 variables with quadratic constraints, which two strings over five steps stay below.
"""

import time

import numpy as np
import pytest

import bess

gurobi_split = pytest.importorskip("contenders.gurobi_split", reason="gurobipy is not installed")

WEIGHTS = {"ones": (1.0, 1.0, 1.0), "S1": (1.0, 1.0, 0.0), "S2": (1.0, 0.5, 0.5), "S3": (1.0, 0.0, 1.0)}


def regular(seed, steps):
    rng = np.random.default_rng(seed)
    state = bess.State(rng.uniform(0.35, 0.65, 2), rng.uniform(25.0, 40.0, 2))
    return state, rng.uniform(20.0, 150.0, steps) * rng.choice([-1.0, 1.0])


@pytest.mark.parametrize("steps", [4, 5])
def test_at_least_a_hundred_times_faster_than_gurobi_and_no_worse(steps):
    system = bess.System.reference(n_strings=2)
    ratios, ours_ms, theirs_ms = [], [], []
    for name, weights in WEIGHTS.items():
        goals = bess.Objectives(derating=weights[0], inverter=weights[1], battery=weights[2])
        splitter = bess.PowerSplit(system, steps, goals)
        for seed in range(5):
            state, demand = regular(seed, steps)
            splitter(state, demand)
            times = []
            for _ in range(5):
                splitter.warm_start = None
                started = time.perf_counter()
                split = splitter(state, demand)
                times.append(time.perf_counter() - started)
            _, objective, gurobi_s = gurobi_split.split(system, state, demand, weights)
            assert split.objective <= objective * 1.001, (name, seed)
            ours_ms.append(np.median(times) * 1e3)
            theirs_ms.append(gurobi_s * 1e3)
            ratios.append(theirs_ms[-1] / ours_ms[-1])
    geometric = float(np.exp(np.mean(np.log(ratios))))
    print(
        f"\n2 strings x {steps} steps: bess {np.median(ours_ms):.2f} ms, "
        f"Gurobi {np.median(theirs_ms):.0f} ms (median); "
        f"geometric mean of the ratio {geometric:.0f}, smallest {min(ratios):.0f}"
    )
    assert geometric >= 100.0
