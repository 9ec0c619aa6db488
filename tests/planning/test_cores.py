"""Claims about threads: OMP_NUM_THREADS says how many, and results are the same for any number."""

from __future__ import annotations

import numpy as np
import pytest

import bess


@pytest.mark.parametrize("n_strings", [20])
def test_plans_bounds_and_splits_are_the_same_bits_for_any_number_of_threads(
    n_strings: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(n_strings)
    system = bess.System.reference(n_strings)
    state = bess.State(rng.uniform(0.1, 0.9, n_strings), rng.uniform(20.0, 45.0, n_strings))
    demand = np.where(np.arange(6) % 4 < 2, 60.0, -60.0) * n_strings * rng.uniform(0.5, 1.0, 6)
    answers = []
    for n_threads in (1, 3):
        monkeypatch.setenv("OMP_NUM_THREADS", str(n_threads))
        plan = bess.plan_power(system, state, demand)
        split = bess.split_power(system, state, demand[:4], node_limit=1)
        values = [plan.request_kw, plan.bound, plan.search_bound, split.request_kw, split.bound]
        answers.append(b"".join(np.asarray(value).tobytes() for value in values))
    assert answers[0] == answers[1]
