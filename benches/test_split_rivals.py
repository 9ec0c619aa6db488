"""The power split beside Gurobi on the same equations, in one run.

``python -m pytest benches/test_split_rivals.py -o addopts= -s``. Gurobi's wheel carries a size-limited
licence: 200 variables with quadratic constraints, which two strings over five steps stay below.
"""

import numpy as np
import pytest

import bess
from contenders import splits

pytest.importorskip("gurobipy", reason="gurobipy is not installed")


@pytest.mark.parametrize("steps", [4, 5])
def test_at_least_a_hundred_times_faster_than_gurobi_and_no_worse(steps):
    system = bess.System.reference(n_strings=2)
    ours_ms, theirs_ms = [], []
    for name, weights in splits.WEIGHTS.items():
        solvers = splits.ours(system, steps, weights), splits.rival("gurobi", system, weights)
        for seed in range(5):
            state, demand_kw = splits.regular(seed, 2, steps)
            ours, theirs = (solve(state, demand_kw) for solve in solvers)
            assert ours.objective <= theirs.objective * 1.001, (name, seed)
            ours_ms.append(ours.seconds * 1e3)
            theirs_ms.append(theirs.seconds * 1e3)
    ratios = np.divide(theirs_ms, ours_ms)
    geometric = float(np.exp(np.mean(np.log(ratios))))
    print(
        f"\n2 strings x {steps} steps: bess {np.median(ours_ms):.2f} ms, "
        f"Gurobi {np.median(theirs_ms):.0f} ms (median); "
        f"geometric mean of the ratio {geometric:.0f}, smallest {ratios.min():.0f}"
    )
    assert geometric >= 100.0
