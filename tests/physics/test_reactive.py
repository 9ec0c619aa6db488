"""Reactive power in the plant: losses over apparent power, limits, and the energy ledger."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bess

SYSTEM = bess.System.reference(n_strings=2)


def _plant(soc: tuple[float, float] = (0.5, 0.5)) -> bess.Plant:
    return bess.Plant(SYSTEM, bess.State(soc=list(soc), temperature_c=[25.0, 25.0]))


@pytest.mark.closed_form
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_losses_are_those_of_the_table_at_the_apparent_power(sign: float) -> None:
    inverter = SYSTEM.strings[0].inverter
    loss = inverter.loss_discharge if sign > 0 else inverter.loss_charge
    flows = _plant().step([sign * 60.0, sign * 30.0], reactive_kvar=[-40.0, 50.0])
    load = np.hypot([60.0, 30.0], [40.0, 50.0]) / inverter.nominal_kw
    expected_kw = inverter.nominal_kw * np.interp(load, inverter.load, loss)
    np.testing.assert_allclose(flows.inverter_loss_kw, expected_kw, rtol=1e-12)
    np.testing.assert_allclose(flows.delivered_kw, [sign * 60.0, sign * 30.0], rtol=1e-12)
    np.testing.assert_allclose(flows.reactive_kvar, [-40.0, 50.0], rtol=1e-12)


def test_reactive_power_of_zero_changes_no_bit_of_a_run() -> None:
    request_kw = 92.0 * np.sin(np.arange(80).reshape(40, 2))
    without = _plant((0.02, 0.97)).run(request_kw)
    with_ = _plant((0.02, 0.97)).run(request_kw, reactive_kvar=np.zeros_like(request_kw))
    for name in (
        "delivered_kw",
        "inverter_loss_kw",
        "battery_loss_kw",
        "soc",
        "node_max_c",
        "inverter_starts",
    ):
        np.testing.assert_array_equal(getattr(with_, name), getattr(without, name))
    assert without.reactive_kvar is None


@settings(max_examples=60, deadline=None)
@given(
    p_kw=st.tuples(st.floats(-92.0, 92.0), st.floats(-92.0, 92.0)),
    q_kvar=st.tuples(st.floats(-92.0, 92.0), st.floats(-92.0, 92.0)),
    soc=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
)
def test_no_inverter_carries_more_than_its_apparent_power_and_energy_is_balanced(
    p_kw: tuple[float, float], q_kvar: tuple[float, float], soc: tuple[float, float]
) -> None:
    flows = _plant(soc).step(p_kw, reactive_kvar=q_kvar)
    apparent_kva = np.hypot(flows.delivered_kw, flows.reactive_kvar)
    assert (apparent_kva <= SYSTEM.nominal_kw * (1.0 + 1e-12)).all()
    drawn_kw = flows.delivered_kw - flows.standby_kw
    # Internal power is what the cells give less what they lose; the rest of the ledger is the inverter's.
    internal_kw = (flows.chemical_kw + flows.ocv_shift_kw) - (
        flows.battery_loss_kw + flows.hysteresis_loss_kw
    )
    np.testing.assert_allclose(internal_kw, drawn_kw + flows.inverter_loss_kw, atol=1e-9)


def test_active_power_comes_first() -> None:
    flows = _plant().step([92.0, 80.0], reactive_kvar=[50.0, 92.0])
    np.testing.assert_allclose(flows.delivered_kw, [92.0, 80.0])
    np.testing.assert_allclose(flows.reactive_kvar, [0.0, np.sqrt(92.0**2 - 80.0**2)], atol=1e-5)


def test_an_inverter_with_reactive_power_alone_runs_on_the_grid_and_its_battery_rests() -> None:
    flows = _plant((0.0, 1.0)).step([0.0, 0.0], reactive_kvar=[40.0, 40.0])
    np.testing.assert_array_equal(flows.current_a, 0.0)
    np.testing.assert_array_equal(flows.standby_kw, flows.inverter_loss_kw)
    assert (flows.standby_kw > 1.0).all() and flows.inverter_starts.tolist() == [1, 1]


@pytest.mark.parametrize(
    ("reactive_kvar", "said"),
    [
        ([0.0, 93.0], "step 0, string 1: reactive power 93 kvar is outside [-92, 92] kvar"),
        ([0.0], "reactive_kvar [kvar] has shape (1,), needs (2,)"),
        ([0.0, np.nan], "reactive power NaN kvar"),
    ],
)
def test_reactive_power_that_no_inverter_has_is_refused(reactive_kvar: list[float], said: str) -> None:
    plant = _plant()
    with pytest.raises(bess.InputError) as error:
        plant.step([0.0, 0.0], reactive_kvar=reactive_kvar)
    assert said in str(error.value)
