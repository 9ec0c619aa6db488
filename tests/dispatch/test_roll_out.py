"""Claims about following a demand with the plant as one store."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bess
from bess.dispatch.aggregate import Aggregate

DT_H, N_STEPS = 0.25, 12


def rolled_out(seed: int) -> tuple[bess.System, Aggregate, bess.State, np.ndarray, Any]:
    """Two to four strings, now and then one out of service, anywhere between empty and full."""
    rng = np.random.default_rng(seed)
    n_strings = int(rng.integers(2, 5))
    system = bess.System.reference(n_strings)
    limit_kw = system.nominal_kw.copy()
    limit_kw[0] *= rng.choice([0.0, 0.5, 1.0])
    plant = Aggregate(system, DT_H, system.initial_state(), limit_kw)
    state = bess.State(rng.uniform(0.0, 1.0, n_strings), rng.uniform(10.0, 48.0, n_strings))
    demand_kw = rng.uniform(-1.2, 1.2, N_STEPS) * plant.power_kw * (rng.random(N_STEPS) > 0.2)
    return system, plant, state, demand_kw, plant.track_demand(state, demand_kw, np.full(N_STEPS, 25.0))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_allocated_power_never_exceeds_the_demand_and_is_nearly_delivered(seed: int) -> None:
    _, plant, _, demand_kw, rolled = rolled_out(seed)
    slack_kw = 1e-6 * plant.power_kw
    assert np.all(rolled.allocated_kw * demand_kw >= 0.0)
    assert np.all(np.abs(rolled.allocated_kw) <= np.abs(demand_kw) + slack_kw)
    assert np.all(np.abs(rolled.delivered_kw) <= np.abs(rolled.allocated_kw) + slack_kw)
    cool = rolled.temperature_c[:, 1:].max(axis=0) < 40.0  # below the start of derating
    within = np.abs(demand_kw) <= plant.power_kw
    missing_kw = np.abs(rolled.allocated_kw) - np.abs(rolled.delivered_kw)
    assert np.all(missing_kw[cool & within] <= 0.02 * plant.power_kw)


@pytest.mark.independent
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_is_delivered_is_what_the_requests_give_when_they_are_rolled_out_alone(seed: int) -> None:
    system, _, state, _, rolled = rolled_out(seed)
    parts = 3
    requests = np.repeat(rolled.request_kw, parts, axis=1)
    flows = bess.rollout(system, state, requests, dt_h=DT_H / parts, ambient_c=25.0, model="midpoint")
    ends = slice(parts - 1, None, parts)
    np.testing.assert_allclose(rolled.soc[:, 1:], flows.soc[:, ends], atol=1e-9)
    np.testing.assert_allclose(rolled.temperature_c[:, 1:], flows.temperature_c[:, ends], atol=1e-9)
    delivered_kw = flows.delivered_kw.sum(axis=0).reshape(N_STEPS, parts).mean(axis=1)
    np.testing.assert_allclose(rolled.delivered_kw, delivered_kw, atol=1e-9)


def test_undeliverable_power_of_an_empty_string_moves_to_the_full_one() -> None:
    system = bess.System.reference(2)
    plant = Aggregate(system, DT_H, system.initial_state(), system.nominal_kw)
    demand_kw = np.full(2, 0.8 * system.nominal_kw[0])
    rolled = plant.track_demand(bess.State([0.0, 0.9], [25.0, 25.0]), demand_kw, np.full(2, 25.0))
    np.testing.assert_allclose(rolled.delivered_kw, demand_kw, rtol=1e-9)
    assert rolled.soc[0, -1] == 0.0 and rolled.soc[1, -1] < 0.9


def test_power_that_no_string_can_take_is_not_allocated() -> None:
    system = bess.System.reference(2)
    plant = Aggregate(system, DT_H, system.initial_state(), system.nominal_kw)
    rolled = plant.track_demand(bess.State([1.0, 1.0], [25.0, 25.0]), np.full(4, -100.0), np.full(4, 25.0))
    # Inverters that are on take their own no-load losses.
    no_load_kw = sum(s.inverter.loss_charge[0] * s.inverter.nominal_kw for s in system.strings)
    np.testing.assert_allclose(rolled.allocated_kw, rolled.delivered_kw, atol=1e-6)
    assert np.abs(rolled.allocated_kw).max() < 1.1 * no_load_kw
    assert np.all(rolled.soc == 1.0)
