"""Capacity in service is estimated: near what the plant of the package loses, and not forgotten."""

import numpy as np
import pytest
from live_cases import controller, measured

import bess
from bess.checkpoints import from_json, to_json


@pytest.mark.parametrize("model", ["kokam-75ah", "schmalstieg", "naumann-lfp"])
def test_the_estimate_is_near_what_the_plant_loses(model: str) -> None:
    document = bess.System.reference(2).document | {"wear": {"model": model}}
    system = bess.System(document)
    live = controller(system=system, policy="equal")
    plant = bess.Plant(system, system.initial_state())
    for k in range(96 * 30):
        demand_kw = 60.0 * (1.0 if (k // 8) % 2 else -1.0)
        answer = live.step(measured(plant.state.soc, plant.state.temperature_c), demand_kw, 900.0 * k)
        plant.step(answer.request_kw, 900.0)
    lost, truth = 1.0 - live.ageing.soh_capacity, 1.0 - plant.state.soh_capacity
    assert (truth > 1e-4).all()
    np.testing.assert_allclose(lost, truth, rtol=0.5)


def test_without_a_cell_model_nothing_ages_and_with_one_nothing_is_forgotten() -> None:
    live = controller(2)
    for k in range(10):
        live.step(measured([0.5, 0.5]), 60.0, 900.0 * k)
    assert (live.ageing.soh_capacity == 1.0).all()

    system = bess.System(bess.System.reference(2).document | {"wear": {"model": "kokam-75ah"}})
    first, second = controller(system=system), controller(system=system)
    for k in range(10):
        first.step(measured([0.5, 0.6]), 60.0 - 12.0 * k, 900.0 * k)
    second.load_state_dict(from_json(to_json(first.state_dict())))
    assert (second.ageing.soh_capacity < 1.0).all()
    np.testing.assert_array_equal(second.ageing.soh_capacity, first.ageing.soh_capacity)
