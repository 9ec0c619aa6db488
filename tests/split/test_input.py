"""Bad input to the power split: one clear error each, and nothing done."""

import numpy as np
import pandas as pd
import pytest

import bess

STEPS = 4
GOOD_STATE = {"soc": [0.5, 0.5], "temperature_c": [25.0, 25.0]}


@pytest.fixture(scope="module")
def system():
    return bess.System.reference(n_strings=2)


@pytest.fixture
def splitter(system):
    return bess.PowerSplit(system, STEPS)


@pytest.mark.parametrize(
    ("demand", "message"),
    [
        ([10.0, float("nan"), 10.0, 10.0], "index 1 is nan"),
        ([10.0, 10.0, float("inf"), 10.0], "finite"),
        ([10.0] * 3, "horizon of 4 steps"),
        ([10.0] * 5, "horizon of 4 steps"),
        ([[10.0] * 4], "shape"),
        (10.0, "shape"),
        (["a"] * 4, "numbers"),
    ],
)
def test_bad_demand_is_refused(splitter, demand, message):
    with pytest.raises(bess.InputError, match=message):
        splitter(bess.State(**GOOD_STATE), demand)


@pytest.mark.parametrize("call", [bess.split_power, bess.plan_power])
def test_one_call_takes_limits_and_temperatures_ahead(system, call):
    state, demand_kw = bess.State(**GOOD_STATE), [40.0] * 4
    limited = call(system, state, demand_kw, limit_kw=[0.0, 92.0])
    assert limited.request_kw[0].tolist() == [0.0] * 4
    assert limited.request_kw[1].tolist() == pytest.approx(demand_kw)
    hot = call(system, state, demand_kw, limit_kw=[0.0, 92.0], ambient_c=[60.0] * 4)
    assert hot != limited


@pytest.mark.parametrize("call", [bess.split_power, bess.plan_power])
def test_a_series_of_hours_is_not_taken_for_quarter_hours(system, call):
    state, quarters = bess.State(**GOOD_STATE), pd.date_range("2024-01-01", periods=4, freq="15min")
    series = pd.Series([10.0] * 4, index=quarters)
    assert call(system, state, series) == call(system, state, series.to_numpy())
    for times, message in (
        (quarters[0] + 4 * (quarters - quarters[0]), r"1 h apart, but a step \(.*\) lasts 0.25 h"),
        (quarters[::-1], "-0.25 h apart"),
        (quarters[[0, 1, 3, 3]], "0 to 0.5 h apart"),
    ):
        with pytest.raises(bess.InputError, match=message):
            call(system, state, series.set_axis(times))


def test_soc_outside_its_window_is_refused():
    document = bess.System.reference().document
    document["battery"]["soc_min"] = 0.1
    narrow = bess.System(document)
    with pytest.raises(bess.InputError, match="soc"):
        bess.split_power(narrow, bess.State([0.05, 0.5], [25.0, 25.0]), [10.0])


def test_state_with_another_number_of_strings_is_refused(splitter):
    with pytest.raises(bess.InputError, match="strings"):
        splitter(bess.State([0.5] * 3, [25.0] * 3), [10.0] * STEPS)


def test_an_object_that_is_not_a_state_is_refused(splitter):
    with pytest.raises(bess.InputError, match="State"):
        splitter(GOOD_STATE, [10.0] * STEPS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"horizon_steps": 0}, "horizon_steps"),
        ({"horizon_steps": 97}, "96"),
        ({"horizon_steps": 4.0}, "integer"),
        ({"horizon_steps": True}, "integer"),
        ({"gap": -1e-3}, "gap"),
        ({"gap": float("nan")}, "gap"),
        ({"dt_h": 0.0}, "dt_h"),
        ({"dt_h": "quarter"}, "dt_h"),
        ({"time_limit_s": -1.0}, "time_limit_s"),
        ({"node_limit": 0}, "node_limit"),
        ({"objectives": {"battery": 1.0}}, "Objectives"),
    ],
)
def test_bad_settings_are_refused(system, arguments, message):
    with pytest.raises(bess.InputError, match=message):
        bess.PowerSplit(system, **{"horizon_steps": STEPS, **arguments})


@pytest.mark.parametrize("ambient", [float("nan"), [25.0] * 3, 500.0])
def test_bad_ambient_is_refused(splitter, ambient):
    with pytest.raises(bess.InputError, match="ambient_c"):
        splitter(bess.State(**GOOD_STATE), [10.0] * STEPS, ambient_c=ambient)


@pytest.mark.parametrize("limit", [[-1.0, 10.0], [93.0, 10.0], [1.0, 2.0, 3.0], [float("nan"), 1.0]])
def test_bad_limit_is_refused(splitter, limit):
    with pytest.raises(bess.InputError, match="limit_kw"):
        splitter(bess.State(**GOOD_STATE), [10.0] * STEPS, limit_kw=limit)


@pytest.mark.parametrize("warm", [np.zeros((2, 3)), np.full((2, 4), np.nan)])
def test_bad_warm_start_is_refused(splitter, warm):
    with pytest.raises(bess.InputError, match="warm_start"):
        splitter.warm_start = warm


def test_mixed_signs_within_a_step_are_refused_by_the_roll_out(system):
    with pytest.raises(bess.InputError, match="sign"):
        bess.rollout(system, bess.State(**GOOD_STATE), np.array([[10.0], [-10.0]]))


def test_a_refused_call_leaves_the_splitter_as_it_was(splitter):
    splitter(bess.State(**GOOD_STATE), [10.0] * STEPS)
    before = splitter.warm_start.copy()
    with pytest.raises(bess.InputError):
        splitter(bess.State(**GOOD_STATE), [10.0] * 3)
    np.testing.assert_array_equal(splitter.warm_start, before)


def test_a_demand_below_the_minimum_power_of_one_inverter_goes_to_the_other():
    document = bess.System.reference(2).document
    document["string"] = [{}, {"inverter": {"min_power_kw": 0.17}}]
    system, state = bess.System(document), bess.State(**GOOD_STATE)
    split = bess.split_power(system, state, [0.0556, -0.0556])
    np.testing.assert_allclose(split.request_kw, [[0.0556, -0.0556], [0.0, 0.0]], rtol=1e-12)
    # With the first one out of service there is none for it, which is said.
    split = bess.PowerSplit(system, 2)(state, [0.0556, -0.0556], limit_kw=[0.0, 92.0])
    np.testing.assert_allclose(split.unmet_kw, 0.0556, rtol=1e-12)
    assert not split.request_kw.any()
