"""Claims about splits of more strings than a relaxation takes: the proof may widen, the answer may not."""

from __future__ import annotations

import numpy as np
import pytest

import bess
from bess.arrays import Array

ENERGY = bess.Objectives.energy(shortfall=3.0)


def problem(seed: int, n_strings: int, n_steps: int) -> tuple[bess.State, Array]:
    rng = np.random.default_rng(seed)
    state = bess.State(rng.uniform(0.05, 0.95, n_strings), rng.uniform(20.0, 45.0, n_strings))
    signs = np.where((np.arange(n_steps) // 4 + seed) % 2, 1.0, -1.0)
    return state, signs * rng.uniform(0.1, 0.8, n_steps) * 92.0 * n_strings


def cost(system: bess.System, state: bess.State, request_kw: Array) -> float:
    flows = bess.rollout(system, state, request_kw)
    undelivered = (flows.availability_loss_kw + flows.derating_loss_kw).sum()
    return float(3.0 * undelivered + flows.inverter_loss_kw.sum() + flows.battery_loss_kw.sum()) * 0.25


@pytest.mark.parametrize(("n_strings", "n_steps"), [(1000, 1), (256, 1), (48, 8), (96, 4)])
def test_it_meets_the_demand_and_beats_the_rules(n_strings: int, n_steps: int) -> None:
    system = bess.System.reference(n_strings)
    state, demand = problem(n_strings + n_steps, n_strings, n_steps)
    split = bess.split_power(system, state, demand, ENERGY)
    np.testing.assert_allclose(split.request_kw.sum(axis=0), demand, rtol=1e-9)
    equal = np.broadcast_to(demand / n_strings, (n_strings, n_steps))
    left = np.where(demand[0] > 0.0, state.soc, 1.0 - state.soc)
    by_soc = np.minimum(np.outer(left / left.sum(), np.abs(demand)), 92.0)
    by_soc += (np.abs(demand) - by_soc.sum(axis=0)) * (92.0 - by_soc) / (92.0 - by_soc).sum(axis=0)
    by_soc *= np.sign(demand)
    reached = cost(system, state, split.request_kw)
    assert split.objective == pytest.approx(reached, rel=1e-6)
    assert reached < 0.98 * min(cost(system, state, equal), cost(system, state, by_soc))
    assert 0.5 * reached < split.bound <= split.objective
    assert (split.status is bess.SplitStatus.OPTIMAL) == (split.gap <= 1e-3)


@pytest.mark.parametrize("seed", range(2))
def test_eight_of_each_string_cost_no_more_than_eight_times_as_much(seed: int) -> None:
    state, demand = problem(seed, 8, 8)
    few = bess.split_power(bess.System.reference(8), state, demand, ENERGY)
    eightfold = bess.State(np.repeat(state.soc, 8), np.repeat(state.temperature_c, 8))
    many = bess.split_power(bess.System.reference(64), eightfold, 8.0 * demand, ENERGY)
    assert many.objective <= 8.0 * few.objective * (1.0 + 2e-3)
    assert many.bound <= 8.0 * few.objective
