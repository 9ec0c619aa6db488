"""Calls from Python, timed by pytest-benchmark: ``make bench``."""

import numpy as np
import pytest

import bess

STATE = bess.State(soc=[0.5, 0.45], temperature_c=[25.0, 30.0])


def test_a_day_of_the_plant(benchmark):
    system = bess.System.reference(n_strings=2)
    request_kw = np.full((96, 2), 39.0) * np.repeat([1.0, -1.0], 48)[:, None]
    benchmark(lambda: bess.Plant(system, STATE).run(request_kw, step_s=900.0))


def test_a_thousand_rollouts(benchmark):
    system = bess.System.reference(n_strings=2)
    request_kw = np.random.default_rng(0).uniform(10.0, 80.0, (1000, 2, 8))
    benchmark(lambda: bess.rollout(system, STATE, request_kw))


@pytest.mark.parametrize("steps", [4, 8])
def test_a_power_split_from_a_cold_start(benchmark, steps):
    splitter = bess.PowerSplit(bess.System.reference(n_strings=2), steps)
    demand_kw = np.full(steps, 78.0)

    def split():
        splitter.warm_start = None
        return splitter(STATE, demand_kw)

    benchmark(split)
