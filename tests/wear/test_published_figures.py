"""Claims: strings age as published, over ten years, and a kWh more costs what the slope says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from published import PUBLISHED

import bess
from bess.control import wear
from bess.plant import Flows

pytestmark = pytest.mark.golden

TEMPERATURES_C = (25.0, 35.0, 45.0)
TEN_YEARS_PCT = {"kokam-75ah": (11, 22, 40), "nmc-a-75ah": (23, 29, 40), "naumann-lfp": (22, 25, 29)}
DAYS = 3650
DEPTH, C_RATE = 0.8, 0.35
HALF_CYCLE_S = DEPTH / C_RATE * 3600.0
SOC_WINDOW = {"soc_min": 0.1, "soc_max": 0.9}


def fleet(model: str, plant_step_s: float) -> bess.PlantEnsemble:
    """One string without heat that cycles between 0.1 and 0.9, at each temperature."""
    document = bess.System.reference(1).document | {"wear": {"model": model}}
    document["battery"] = document["battery"] | SOC_WINDOW | {"r_scale": 1e-9}
    document["inverter"] = document["inverter"] | {"nominal_kw": 100.0}
    states = [bess.State([0.5], [temperature_c]) for temperature_c in TEMPERATURES_C]
    return bess.PlantEnsemble(bess.System(document), states, plant_step_s=plant_step_s)


def run(strings: bess.PlantEnsemble, request_kw: NDArray[np.float64], step_s: float) -> Flows:
    ambient = np.repeat(np.array(TEMPERATURES_C)[:, None], request_kw.shape[1], axis=1)
    return strings.run(request_kw[:, :, None], step_s, ambient_c=ambient)


@pytest.mark.parametrize("model", PUBLISHED)
def test_ten_years_lose_what_was_published(model: str) -> None:
    standing = run(fleet(model, 900.0), np.zeros((3, 4 * DAYS)), step_s=21_600.0)
    assert np.all(standing.cyclic_loss == 0.0)
    calendar = standing.calendar_loss[:, -1, 0]

    # Full and empty are limits, so every half cycle is 0.8 deep; ten steps fill what capacity is left.
    strings = fleet(model, HALF_CYCLE_S / 60.0)
    cycle = np.repeat([-100.0, 100.0], 10)
    for _ in range(182):
        left = np.array([state.soh_capacity for state in strings.states])
        flows = run(strings, left * np.tile(cycle, 25), step_s=HALF_CYCLE_S / 10.0)
    assert flows.soc.min() == pytest.approx(0.1)
    assert flows.soc.max() == pytest.approx(0.9)
    cyclic = flows.cyclic_loss[:, -1, 0]

    for index, temperature_c in enumerate(TEMPERATURES_C):
        days, cycles = PUBLISHED[model](temperature_c, 0.5, DEPTH, C_RATE)
        assert calendar[index] == pytest.approx(days.loss(DAYS), rel=1e-9)
        # 25 cycles each time; the first half cycle begins at 0.5.
        assert cyclic[index] == pytest.approx(cycles.loss(182 * 25 * DEPTH - 0.2), rel=1e-3)
    np.testing.assert_allclose(100.0 * (calendar + cyclic), TEN_YEARS_PCT[model], atol=0.6)


# From 25 to 40 degC at the end of the third year, at 200 EUR/kWh and an end of life at 80 %: cents per kWh
# discharged, and per kWh of capacity and day.
CYCLING_CT_KWH = {"kokam-75ah": (2.5, 6.2), "nmc-a-75ah": (5.6, 7.1), "naumann-lfp": (2.0, 2.0)}
CALENDAR_CT_KWH_DAY = {"kokam-75ah": (0.5, 1.5), "nmc-a-75ah": (0.4, 1.7), "naumann-lfp": (3.4, 4.7)}


@pytest.mark.parametrize("model", PUBLISHED)
@pytest.mark.parametrize(("temperature_c", "which"), [(25.0, 0), (40.0, 1)])
def test_the_next_kwh_and_the_next_day_cost_what_the_slope_says(
    model: str, temperature_c: float, which: int
) -> None:
    days, cycles = PUBLISHED[model](temperature_c, 0.5, DEPTH, 0.35)
    calendar, cyclic = days.loss(1095), cycles.loss(1095)
    plant = bess.System(bess.System.reference(2).document | {"wear": {"model": model}})
    state = bess.State(
        [0.5, 0.5],
        [25.0, 25.0],
        soh_capacity=np.full(2, 1.0 - calendar - cyclic),
        cyclic_loss=[cyclic, cyclic],
    )
    now = wear.marginal(plant, state)

    per_kwh = now.cycling_eur_kwh(DEPTH, temperature_c, c_rate=0.35)
    per_day = now.calendar_eur_day(0.5, temperature_c) / plant.nominal_energy_kwh[:, None]
    assert per_kwh.shape == per_day.shape == (2, 1)
    exact = cycles.slope(1095) * 200.0 / 0.2
    np.testing.assert_allclose(per_kwh * state.soh_capacity[:, None], exact, rtol=1e-9)
    np.testing.assert_allclose(per_day, days.slope(1095) * 200.0 / 0.2, rtol=1e-9)
    assert 100.0 * exact == pytest.approx(CYCLING_CT_KWH[model][which], abs=0.06)
    np.testing.assert_allclose(100.0 * per_day, CALENDAR_CT_KWH_DAY[model][which], atol=0.06)
    # The same price by charge: an equivalent full cycle moves the capacity twice.
    ah = 2.0 * plant.capacity_ah * state.soh_capacity
    kwh = plant.nominal_energy_kwh * state.soh_capacity
    per_ah = now.cycling_eur_ah(DEPTH, temperature_c, c_rate=0.35)
    np.testing.assert_allclose(per_ah[:, 0] * ah, per_kwh[:, 0] * kwh)


def test_each_string_has_its_own_model_price_and_temperature() -> None:
    document = bess.System.reference(3).document | {
        "wear": {"model": "kokam-75ah"},
        "string": [{}, {"wear": {"model": "throughput", "eur_per_mwh": 40.0}}, {"wear": {"model": "none"}}],
    }
    plant = bess.System(document)
    state = bess.State([0.5] * 3, [25.0, 40.0, 25.0])
    now = wear.marginal(plant, state)
    per_kwh = now.cycling_eur_kwh([0.4, 0.8], state.temperature_c[:, None])
    assert per_kwh.shape == (3, 2)
    assert per_kwh[0, 1] > per_kwh[0, 0] > 0.0
    np.testing.assert_allclose(per_kwh[1], 0.04)
    np.testing.assert_array_equal(per_kwh[2], 0.0)
    np.testing.assert_array_equal(now.calendar_eur_day(0.5, 25.0)[1:], 0.0)


def test_points_that_fit_no_string_are_refused() -> None:
    now = wear.marginal(bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0]))
    for depth in (np.ones((3, 2)), np.ones((2, 2, 2))):
        with pytest.raises(bess.InputError, match=r"must broadcast against \(2 strings, points\), not depth"):
            now.cycling_eur_kwh(depth, 25.0)
    with pytest.raises(bess.InputError, match="cyclic_loss has 1"):
        bess.State([0.5, 0.5], [25.0, 25.0], cyclic_loss=[0.1])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"depth": np.nan}, "wear: depth is nan"),
        ({"depth": 2.0}, r"wear: depth 2 is outside \[0, 1\]"),
        ({"depth": "0.8"}, "wear: depth must be an array of numbers"),
        ({"soc": [0.5, -0.1]}, r"wear: soc -0.1 is outside \[0, 1\]"),
        ({"c_rate": -1.0}, r"wear: c_rate -1 is outside \[0, 100\]"),
        ({"temperature_c": 298.15}, r"wear: temperature_c 298.15 is outside \[-60, 150\]"),
        ({"temperature_c": np.nan}, "wear: temperature_c is nan"),
    ],
)
def test_a_price_of_an_impossible_cycle_is_refused(points: dict[str, Any], message: str) -> None:
    """Which would be 0 or that of another cycle."""
    plant = bess.System(bess.System.reference(1).document | {"wear": {"model": "nmc-a-75ah"}})
    now = wear.marginal(plant, bess.State([0.5], [25.0]))
    for price in (now.cycling_eur_kwh, now.cycling_eur_ah):
        with pytest.raises(bess.InputError, match=message):
            price(**{"depth": 0.8, "temperature_c": 25.0} | points)
    if not {"depth", "c_rate"} & points.keys():
        with pytest.raises(bess.InputError, match=message):
            now.calendar_eur_day(**{"soc": 0.5, "temperature_c": 25.0} | points)
