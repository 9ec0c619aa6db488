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


@pytest.mark.parametrize("model", ["kokam-75ah", "schmalstieg", "naumann-lfp"])
def test_an_outage_of_the_service_ages_the_strings_as_much_as_the_same_time_in_service(model: str) -> None:
    system = bess.System(bess.System.reference(2).document | {"wear": {"model": model}})
    lost = []
    for step_s in (3600.0, 20.0 * 86_400.0):
        live = controller(system=system, policy="equal")
        for k in range(1 + round(20.0 * 86_400.0 / step_s)):
            live.step(measured([0.6, 0.6]), 0.0, step_s * k)
        lost.append(1.0 - live.ageing.soh_capacity)
    np.testing.assert_allclose(lost[1], lost[0], rtol=0.01)


def test_a_clock_that_began_in_1970_ages_nothing_when_it_is_set() -> None:
    system = bess.System(bess.System.reference(2).document | {"wear": {"model": "kokam-75ah"}})
    live = controller(system=system, policy="equal")
    for now_s in (0.0, 900.0, 1.8e9, 1.8e9 + 900.0):
        live.step(measured([0.6, 0.6]), 0.0, now_s)
    assert (live.ageing.soh_capacity > 0.999).all()


def _aged(soh_capacity: float) -> bess.System:
    document = bess.System.reference(2).document
    return bess.System(document | {"system": document["system"] | {"initial_soh_capacity": soh_capacity}})


def test_a_calibration_charges_an_aged_string_with_no_more_than_it_can_take() -> None:
    live = controller(system=_aged(0.7), policy="equal", calibration_kw=92.0)
    live.calibration.begin(0)
    soc = 0.98
    answer = live.step(measured([soc, 0.6]), 0.0, 0.0)
    room_kwh = (1.0 - soc) * 0.7 * live.system.nominal_energy_kwh[0]
    assert -answer.request_kw[0] * 0.25 == pytest.approx(room_kwh)


def test_the_fallback_asks_an_aged_string_for_no_more_than_it_holds() -> None:
    live = controller(system=_aged(0.7), policy="equal")
    answer = live.fallback(measured([0.04, 0.0]), 90.0, "why")
    assert answer.request_kw[0] * 0.25 == pytest.approx(0.04 * 0.7 * live.system.nominal_energy_kwh[0])
