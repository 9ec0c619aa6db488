"""Properties of the plant on any state and request (hypothesis)."""

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bess
from bess.plant import Flows

N_STRINGS, N_STEPS = 3, 4
SCALES = (1.0, 1.6, 0.7)


def unequal_document() -> dict[str, Any]:
    document = copy.deepcopy(bess.System.reference(N_STRINGS).document)
    document["string"] = [
        {"battery": {"r_scale": scale, "soc_min": 0.05 * index, "soc_max": 1.0 - 0.03 * index}}
        for index, scale in enumerate(SCALES)
    ]
    document["string"][2]["thermal"] = {"spatial": {"nodes": 24}}
    return document


SYSTEM = bess.System(unequal_document())
LOW = np.array([s.battery.soc_min for s in SYSTEM.strings])
HIGH = np.array([s.battery.soc_max for s in SYSTEM.strings])


def array(low: float, high: float, *shape: int) -> st.SearchStrategy[Any]:
    size = int(np.prod(shape))
    values = st.floats(low, high, allow_nan=False)
    edges = st.sampled_from([low, 0.5 * (low + high), high])
    return st.lists(values | edges, min_size=size, max_size=size).map(lambda v: np.reshape(v, shape))


requests = array(-92.0, 92.0, N_STEPS, N_STRINGS)
fills = array(0.0, 1.0, N_STRINGS)
temperatures = array(-10.0, 62.0, N_STRINGS)
laws = st.sampled_from(["table", "pi"])


def plant(system: bess.System, fill: Any, temperature_c: Any, law: Any = "table") -> bess.Plant:
    low = np.array([s.battery.soc_min for s in system.strings])
    high = np.array([s.battery.soc_max for s in system.strings])
    return bess.Plant(system, bess.State(low + fill * (high - low), temperature_c), derating_law=law)


def assert_identical(one: Flows, other: Flows) -> None:
    for name, value in vars(one).items():
        np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


@settings(max_examples=60, deadline=None)
@given(requests, fills, temperatures, laws)
def test_losses_are_never_negative_soc_stays_inside_and_nothing_is_shed_silently(
    request_kw: Any, fill: Any, temperature_c: Any, law: str
) -> None:
    flows = plant(SYSTEM, fill, temperature_c, law).run(request_kw)
    for loss in (
        flows.availability_loss_kw,
        flows.derating_loss_kw,
        flows.inverter_loss_kw,
        flows.battery_loss_kw,
    ):
        assert np.all(loss >= 0.0)
    assert np.all((flows.soc >= LOW) & (flows.soc <= HIGH))
    assert np.all((flows.derating_factor >= 0.0) & (flows.derating_factor <= 1.0))
    accounted = np.abs(flows.delivered_kw) + flows.availability_loss_kw + flows.derating_loss_kw
    np.testing.assert_allclose(accounted, np.abs(request_kw), atol=1e-10)
    assert np.all(flows.delivered_kw * request_kw >= 0.0)
    shed = (flows.availability_loss_kw > 1e-9) | (flows.derating_loss_kw > 1e-9)
    assert np.all(flows.limits[shed] != 0)
    np.testing.assert_allclose(flows.ledger_residual_kwh, 0.0, atol=1e-11)
    assert np.all(flows.node_max_c >= flows.temperature_c - 1e-9)


@settings(max_examples=20, deadline=None)
@given(requests, fills, temperatures, st.permutations(range(N_STRINGS)))
def test_permuting_strings_permutes_results(
    request_kw: Any, fill: Any, temperature_c: Any, order: list[int]
) -> None:
    document = unequal_document()
    document["string"] = [document["string"][index] for index in order]
    straight = plant(SYSTEM, fill, temperature_c).run(request_kw, nodes=True)
    permuted = plant(bess.System(document), fill[order], temperature_c[order]).run(
        request_kw[:, order], nodes=True
    )
    residual = {"ledger_residual_kwh"}  # a sum over strings, in their order
    of_the_plant = {name for name, value in vars(straight).items() if value is None or value.ndim == 1}
    for name in set(vars(straight)) - residual - of_the_plant:
        np.testing.assert_array_equal(
            getattr(straight, name)[:, order], getattr(permuted, name), err_msg=name
        )


@settings(max_examples=20, deadline=None)
@given(requests, fills, temperatures, laws)
def test_a_run_is_its_steps_bit_by_bit_also_across_a_snapshot(
    request_kw: Any, fill: Any, temperature_c: Any, law: str
) -> None:
    whole = plant(SYSTEM, fill, temperature_c, law).run(request_kw, nodes=True)
    stepped = plant(SYSTEM, fill, temperature_c, law)
    for index, request in enumerate(request_kw):
        flows = stepped.step(request)
        assert_identical(flows, whole.map(lambda values, i=index: values[i]))  # type: ignore[misc]
        resumed = plant(SYSTEM, fill, temperature_c, law)
        resumed.restore(stepped.snapshot())
        stepped = resumed


@settings(max_examples=20, deadline=None)
@given(requests, fills, temperatures)
def test_scenarios_do_not_influence_each_other(request_kw: Any, fill: Any, temperature_c: Any) -> None:
    soc = LOW + fill * (HIGH - LOW)
    states = [
        bess.State(soc, temperature_c),
        bess.State(soc[::1], temperature_c[::-1]),
        bess.State(HIGH, temperature_c),
    ]
    fleet = bess.PlantEnsemble(SYSTEM, states).run(np.stack([request_kw, -request_kw, request_kw]))
    for index, (state, sign) in enumerate(zip(states, (1.0, -1.0, 1.0), strict=True)):
        alone = bess.Plant(SYSTEM, state).run(sign * request_kw)
        assert_identical(alone, fleet.map(lambda values, i=index: values[i]))  # type: ignore[misc]


@settings(max_examples=30, deadline=None)
@given(fills, array(0.0, 40.0, N_STRINGS), array(1.0, 60.0, N_STRINGS), st.floats(0.0, 30.0))
def test_more_heat_is_never_cooler(fill: Any, temperature_c: Any, power_kw: Any, more_kw: float) -> None:
    # From the middle of the window no limit binds within the step, so more power is more heat.
    fill = 0.4 + 0.2 * fill
    cool = plant(SYSTEM, fill, temperature_c).step(power_kw)
    warm = plant(SYSTEM, fill, temperature_c).step(power_kw + more_kw)
    assert cool.node_temperature_c is not None and warm.node_temperature_c is not None
    assert np.all(warm.battery_loss_kw >= cool.battery_loss_kw - 1e-12)
    gain = warm.node_temperature_c - cool.node_temperature_c
    assert np.all(gain[np.isfinite(gain)] >= -1e-10)


@pytest.mark.parametrize(
    ("request_kw", "step_s", "words"),
    [
        ([93.0, 0.0, 0.0], 900.0, "string 0: requested power 93 kW is outside"),
        ([0.0, float("nan"), 0.0], 900.0, "string 1: requested power NaN kW"),
        ([0.0, 0.0], 900.0, "has shape"),
        ("full power", 900.0, "plant: request_kw [kW] must be an array of numbers"),
        ([0.0, 0.0, 0.0], 905.0, "does not divide a control step of 905 s"),
        ([0.0, 0.0, 0.0], -900.0, "control step -900 s is outside [10, 86400] s"),
        ([0.0, 0.0, 0.0], float("nan"), "control step NaN s is outside [10, 86400] s"),
    ],
)
def test_bad_input_is_refused_in_one_sentence_and_nothing_advances(
    request_kw: Any, step_s: float, words: str
) -> None:
    subject = plant(SYSTEM, np.full(3, 0.5), np.full(3, 25.0))
    before = subject.snapshot()
    with pytest.raises(bess.InputError) as caught:
        subject.step(request_kw, step_s)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    for name, value in vars(before).items():
        np.testing.assert_array_equal(value, getattr(subject.snapshot(), name))


@pytest.mark.parametrize("ambient_c", [float("nan"), 400.0, [25.0, 25.0]])
def test_an_impossible_ambient_is_refused(ambient_c: Any) -> None:
    with pytest.raises(bess.InputError, match="ambient"):
        plant(SYSTEM, np.full(3, 0.5), np.full(3, 25.0)).step(np.zeros(3), ambient_c=ambient_c)


def test_an_invalid_snapshot_is_refused() -> None:
    subject = plant(SYSTEM, np.full(3, 0.5), np.full(3, 25.0))
    snapshot = subject.snapshot()
    snapshot.soc[1] = 1.2
    with pytest.raises(bess.InputError, match=r"string 1: soc 1.2 is outside \[0.05, 0.97\]"):
        subject.restore(snapshot)
