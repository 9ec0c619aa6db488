"""Strings that give power and take no set-points: the others make up for it."""

import numpy as np
import pytest
from live_cases import controller, measured


def drive(live, demand_kw: float, still_kw: float, steps: int, *, meter: bool):  # type: ignore[no-untyped-def]
    """Yield answers while the third string does not answer and gives its power all the same."""
    power_kw = live.last_kw
    for k in range(3, 3 + steps):
        soc = np.array([0.6 - 1e-4 * k, 0.6 - 1e-4 * k, np.nan])
        plant_kw = power_kw[:2].sum() + still_kw if meter else np.nan
        said_kw = np.append(power_kw[:2], np.nan)
        reading = measured(soc, power_kw=said_kw, available=[True, True, False], plant_kw=plant_kw)
        answer = live.step(reading, demand_kw, 10.0 * k)
        power_kw = answer.request_kw
        yield answer


def test_the_last_known_power_of_a_silent_string_counts_until_its_watchdog_has_acted() -> None:
    live = controller(3, policy="equal", control_step_s=10.0, watchdog_s=60.0)
    power_kw = np.zeros(3)
    for k in range(3):
        answer = live.step(measured([0.6 - 1e-4 * k] * 3, power_kw=power_kw), 210.0, 10.0 * k)
        power_kw = answer.request_kw
    sums = [answer.request_kw.sum() for answer in drive(live, 150.0, np.nan, 9, meter=False)]
    np.testing.assert_allclose(sums[:5], 150.0 - power_kw[2])
    np.testing.assert_allclose(sums[-2:], 150.0)


@pytest.mark.parametrize("demand_kw", [150.0, 40.0, -60.0])
def test_the_meter_of_the_plant_knows_what_a_silent_string_gives(demand_kw: float) -> None:
    live = controller(3, control_step_s=10.0)
    *_, answer = drive(live, demand_kw, 60.0, 20, meter=True)
    assert answer.request_kw.sum() == pytest.approx(demand_kw - 60.0)
    assert answer.unmet_kw == 0.0
    assert "string 2 flows" in answer.reasons[2]
    assert "it still supplies 60 kW" in answer.reasons[2]


def test_a_string_at_rest_gives_nothing_whatever_the_meter_adds() -> None:
    live = controller(3, control_step_s=10.0)
    *_, answer = drive(live, 150.0, 1.0, 3, meter=True)
    assert not answer.flowing_kw.any()
    assert answer.request_kw.sum() == pytest.approx(150.0)


def test_power_that_no_inverter_can_give_is_not_believed() -> None:
    live = controller(3, control_step_s=10.0)
    reading = measured([0.6] * 3, power_kw=[50.0, 50.0, 1e6], available=[True, True, False])
    answer = live.step(reading, 150.0, 0.0)
    assert answer.request_kw.sum() == pytest.approx(150.0)


def test_a_string_that_follows_nobody_counts_with_what_it_gives() -> None:
    live = controller(3, control_step_s=10.0)
    power_kw = np.zeros(3)
    for k in range(12):
        soc = 0.6 - 1e-4 * k * np.ones(3)
        answer = live.step(measured(soc, power_kw=power_kw), 100.0, 10.0 * k)
        power_kw = np.append(answer.request_kw[:2], 60.0 + 0.01 * k)  # stuck at its power
        total_kw = power_kw.sum()
    assert total_kw == pytest.approx(100.0, abs=0.05)
