"""Measurements that lie: each is found, named, and costs no more than that string."""

import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_cases import controller, measured

import bess
from bess.checkpoints import to_json


def reasons_of(answer, string):  # type: ignore[no-untyped-def]
    return answer.reasons[string].partition(": ")[2]


def test_a_frozen_state_of_charge_takes_the_string_out_and_names_it() -> None:
    live = controller(2, control_step_s=60.0, frozen_readings=5)
    soc = np.array([0.6, 0.6])
    for k in range(30):
        answer = live.step(measured(soc), 120.0, 60.0 * k)
        soc[1] -= answer.request_kw[1] / 266.0 / 60.0
        if "has been constant at 60 % for" in answer.reasons[0]:
            break
    assert k < 10
    assert answer.request_kw[0] == 0.0
    assert answer.request_kw[1] == pytest.approx(92.0)
    assert answer.unmet_kw == pytest.approx(28.0)
    # The value moves again: within two steps all is met.
    soc[0] = 0.55
    for later in (1, 2):
        answer = live.step(measured(soc), 120.0, 60.0 * (k + later))
    assert answer.unmet_kw == 0.0


def test_a_state_of_charge_that_stands_still_at_rest_is_not_frozen() -> None:
    live = controller(2, control_step_s=60.0, frozen_readings=5)
    for k in range(30):
        answer = live.step(measured([0.6, 0.6]), 0.0, 60.0 * k)
    assert not any("stood" in reason for reason in answer.reasons)


def test_whole_per_cents_are_not_frozen_between_two_of_them() -> None:
    live = controller(1, control_step_s=10.0, frozen_readings=5)
    soc = 0.6
    for k in range(300):
        answer = live.step(measured([round(soc, 2)]), 40.0, 10.0 * k)
        assert answer.unmet_kw == 0.0
        soc -= 40.0 / 266.0 / 360.0


@pytest.mark.parametrize(
    ("soc", "temperature_c", "words"),
    [
        ([1.3, 0.5], 25.0, "its state of charge of 130 % is implausible"),
        ([-0.2, 0.5], 25.0, "its state of charge of -20 % is implausible"),
        ([0.5, 0.5], [400.0, 25.0], "its temperature of 400 °C is implausible"),
        ([np.nan, 0.5], 25.0, "its state of charge is missing"),
    ],
)
def test_what_cannot_be_takes_the_string_out(soc, temperature_c, words) -> None:  # type: ignore[no-untyped-def]
    answer = controller(2).step(measured(soc, temperature_c), 60.0, 0.0)
    np.testing.assert_allclose(answer.request_kw, [0.0, 60.0])
    assert answer.reasons[0] == f"string 0 rests: {words}"


@pytest.mark.parametrize("drives", [True, False])
def test_a_power_beyond_its_inverter_takes_the_string_out_and_moves_no_state_of_charge(drives: bool) -> None:
    live = controller(2, control_step_s=10.0)
    live.drives = drives
    live.step(measured([0.5, 0.5], power_kw=[0.0, 0.0]), 60.0, 0.0)
    answer = live.step(measured([0.5, 0.5], power_kw=[39_000.0, 0.0]), 60.0, 10.0)
    reason = "its power of 39000 kW is implausible, its inverter has 92 kW; tried again in 20 s"
    assert reasons_of(answer, 0) == reason
    np.testing.assert_allclose(answer.request_kw, [0.0, 60.0])
    assert live.valid is not None and live.valid.soc_low[0] == live.valid.soc_high[0] == 0.5


def test_a_string_that_is_out_of_service_stays_so_while_its_state_of_charge_is_missing() -> None:
    live = controller(2, control_step_s=10.0)
    for k, soc in enumerate((0.5, 0.5, np.nan)):
        power_kw = [39_000.0 if k else 0.0, 0.0]
        answer = live.step(measured([soc, 0.5], power_kw=power_kw), 60.0, 10.0 * k)
    assert answer.in_service.tolist() == [False, True]


def test_powers_of_many_megawatts_are_named_as_plain_numbers() -> None:
    document = tomllib.loads(bess.System.reference(2).to_toml())
    document["inverter"]["nominal_kw"] = 20_000.0
    live = controller(2, bess.System(document), policy="soc", control_step_s=10.0)
    for k in range(4):
        answer = live.step(measured([0.5, 0.5], power_kw=[12_500.0, 0.0]), 0.0, 10.0 * k)
    assert "0 kW set, 12500 kW measured; it still supplies 12500 kW" in answer.reasons[0]


def test_after_a_jump_the_worse_of_both_values_counts_until_readings_agree() -> None:
    live = controller(2, control_step_s=10.0)
    live.step(measured([0.05, 0.5]), 0.0, 0.0)
    for k in (1, 2):
        answer = live.step(measured([0.9, 0.5]), 184.0, 10.0 * k)
        assert "jumped from 5 % to 90 %" in answer.reasons[0]
        assert live.valid.soc_low[0] < 0.051
        assert live.valid.soc_high[0] == pytest.approx(0.9)
    answer = live.step(measured([0.9, 0.5]), 184.0, 30.0)
    answer = live.step(measured([0.9, 0.5]), 184.0, 40.0)
    assert live.valid.soc_low[0] == pytest.approx(0.9)
    assert "jumped" not in answer.reasons[0]


def test_a_missing_state_of_charge_is_estimated_for_a_while() -> None:
    live = controller(1, control_step_s=10.0, late_after_s=60.0)
    live.step(measured([0.5]), 80.0, 0.0)
    met = []
    for k in range(1, 12):
        answer = live.step(measured([np.nan]), 80.0, 10.0 * k)
        met.append(answer.unmet_kw == 0.0)
    assert met == [True] * 6 + [False] * 5


@pytest.mark.parametrize(("gives", "cap_kw"), [(0.0, 0.0), (0.5, 46.0), (-1.0, 0.0)])
def test_a_string_that_does_not_follow_is_relieved_by_the_others(gives: float, cap_kw: float) -> None:
    live = controller(2, control_step_s=10.0, retry_after_s=100.0)
    rng = np.random.default_rng(1)
    power = np.zeros(2)
    totals = []
    for k in range(4):
        soc = 0.6 + 1e-3 * rng.standard_normal(2)
        answer = live.step(measured(soc, power_kw=power), 120.0, 10.0 * k)
        power = answer.request_kw * np.array([min(1.0, abs(gives)) * np.sign(gives) if gives else 0.0, 1.0])
        totals.append(power.sum())
    assert "string 0" in answer.reasons[0] and "it does not follow its set-point:" in answer.reasons[0]
    assert answer.request_kw[0] <= cap_kw + 1e-9
    assert totals[-1] >= 92.0 - 1e-6


def test_a_frozen_state_of_charge_stays_out_though_the_power_is_alive() -> None:
    live = controller(2, control_step_s=60.0, frozen_readings=5)
    soc, power, carried = np.array([0.6, 0.6]), np.zeros(2), []
    for k in range(14):
        answer = live.step(measured(soc, power_kw=power), 120.0, 60.0 * k)
        power = answer.request_kw
        soc[1] -= power[1] / 266.0 / 60.0
        carried.append(power[0] != 0.0)
    assert carried[:2] == [True, True]
    # Out from the first time on until it is tried again after 300 s.
    first = carried.index(False)
    assert not any(carried[first : first + 5])


def test_a_string_whose_every_value_stands_still_is_named_for_that() -> None:
    live = controller(2, control_step_s=10.0)
    for k in range(12):
        demand_kw = 120.0 if k < 8 else 60.0
        answer = live.step(measured([0.6, 0.6 - 1e-4 * k], power_kw=[60.0, 60.0 + k]), demand_kw, 10.0 * k)
        if k == 0:
            live.last_kw = np.array([60.0, 60.0])
    assert "its state of charge has been constant at 60 % and its power at 60 kW" in answer.reasons[0]
    assert answer.request_kw[0] == 0.0
    # Any value that moves is enough to be believed again.
    power = [0.0, answer.request_kw[1]]
    live.step(measured([0.6, 0.6], power_kw=power), 60.0, 120.0)
    assert live.valid is not None and live.valid.in_service[0]


def test_a_string_that_was_relieved_is_tried_again() -> None:
    live = controller(2, control_step_s=10.0, retry_after_s=50.0)
    power = np.zeros(2)
    asked = []
    for k in range(20):
        answer = live.step(measured(0.6 + 1e-4 * k * np.ones(2), power_kw=power), 150.0, 10.0 * k)
        alive = k > 4
        power = answer.request_kw * np.array([float(alive), 1.0])
        asked.append(answer.request_kw[0])
    assert 0.0 in asked
    assert asked[-1] > 50.0


@pytest.mark.parametrize(
    ("power_kw", "plant_kw"),
    [([np.inf, 0.0, -np.inf], 50.0), ([20.0, 0.0, 20.0], np.inf), ([20.0, 0.0, 20.0], 1e9)],
)
def test_a_meter_counts_only_with_plausible_readings(power_kw: list[float], plant_kw: float) -> None:
    live = controller(3, control_step_s=10.0)
    reading = measured([0.5] * 3, power_kw=power_kw, available=[True, False, True], plant_kw=plant_kw)
    for k in range(2):
        assert not live.step(reading, 40.0, 10.0 * k).flowing_kw.any()


ODD = st.sampled_from([np.nan, np.inf, -np.inf, -1.0, 0.0, 0.3, 0.5, 0.999, 1.0, 50.0, 1e300])


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_no_measurements_whatever_bring_a_controller_down(data: st.DataObject) -> None:
    live = controller(3, control_step_s=10.0, policy="soc")
    now_s = 0.0
    for _ in range(6):
        values = {
            name: np.array(data.draw(st.lists(ODD, min_size=3, max_size=3)))
            for name in ("soc", "temperature_c", "power_kw", "charge_limit_kw", "discharge_limit_kw")
        }
        soc, temperature_c = values.pop("soc"), values.pop("temperature_c")
        available = np.array(data.draw(st.lists(st.booleans(), min_size=3, max_size=3)))
        demand_kw = data.draw(st.floats(-1e6, 1e6))
        reading = measured(soc, temperature_c, available=available, plant_kw=data.draw(ODD), **values)
        now_s += data.draw(st.sampled_from([0.0, 1.0, 10.0, 1e5]))
        for answer in (live.step(reading, demand_kw, now_s), live.fallback(reading, demand_kw, "")):
            assert np.isfinite(answer.request_kw).all()
            assert (np.abs(answer.request_kw) <= 92.0 + 1e-9).all()
            asked_kw = demand_kw - answer.flowing_kw.sum()
            assert (answer.request_kw * np.sign(asked_kw) >= 0.0).all()
            assert not answer.request_kw[~available].any()
            sum_kw = answer.request_kw.sum() + np.sign(asked_kw) * answer.unmet_kw
            assert abs(sum_kw - asked_kw) <= 1e-8 * max(1.0, abs(demand_kw))
        text = to_json(live.state_dict())
        assert "NaN" not in text and "Infinity" not in text
