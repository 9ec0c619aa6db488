"""Claims about ``bess.rollout`` that a pocket calculator can check, and about what it refuses."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

import bess
from bess import _core

pytestmark = pytest.mark.closed_form

OCV_50_V = {"charge": 3.702 * 192, "discharge": 3.686 * 192}
R_25_OHM = 2.5e-3 * 192 / 4
NOMINAL_LOSS_KW = {"charge": 0.0193 * 92.0, "discharge": 0.0177 * 92.0}
HALF = bess.State([0.5, 0.5], [25.0, 25.0])


@pytest.fixture(scope="module")
def system() -> bess.System:
    return bess.System.reference()


@pytest.mark.parametrize(("direction", "sign"), [("charge", -1.0), ("discharge", 1.0)])
def test_one_step_at_nominal_power_is_the_root_of_its_quadratic(
    system: bess.System, direction: str, sign: float
) -> None:
    roll = bess.rollout(system, HALF, [[sign * 92.0], [0.0]])
    v, r, loss = OCV_50_V[direction], R_25_OHM, NOMINAL_LOSS_KW[direction]
    internal_w = (92.0 + sign * loss) * 1e3
    current = sign * (v - math.sqrt(v**2 - sign * 4.0 * r * internal_w)) / (2.0 * r)
    heat_kw = r * current**2 / 1e3
    np.testing.assert_allclose(roll.inverter_loss_kw[0], loss, rtol=1e-12)
    np.testing.assert_allclose(roll.current_a[0], sign * current, rtol=1e-10)
    np.testing.assert_allclose(roll.battery_loss_kw[0], heat_kw, rtol=1e-10)
    np.testing.assert_allclose(roll.soc[0], 0.5 - sign * current * 0.25 / 376.0, rtol=1e-12)
    np.testing.assert_allclose(roll.temperature_c[0], 25.0 + 900.0 * 6.2e-7 * heat_kw * 1e3, rtol=1e-12)
    # AC power in = change of chemical energy + heat + inverter loss, in either direction.
    np.testing.assert_allclose(sign * 92.0, v * roll.current_a[0] / 1e3 - heat_kw - loss, rtol=1e-10)


def test_a_string_without_a_request_is_off_and_cools(system: bess.System) -> None:
    roll = bess.rollout(system, bess.State([0.5, 0.5], [45.0, 25.0]), np.zeros((2, 1)))
    assert not np.any(roll.inverter_loss_kw)
    assert not np.any(roll.current_a)
    np.testing.assert_array_equal(roll.soc[:, 0], [0.5, 0.5])
    np.testing.assert_allclose(roll.temperature_c[:, 0], [45.0 - 900.0 * 1.386e-5 * 20.0, 25.0], rtol=1e-14)


@pytest.mark.parametrize(("soc", "sign", "end"), [(0.99, -1.0, 1.0), (0.12, 1.0, 0.0)])
def test_a_string_that_saturates_ends_exactly_on_its_limit_and_sheds_the_rest(
    system: bess.System, soc: float, sign: float, end: float
) -> None:
    roll = bess.rollout(system, bess.State([soc, 0.5], [25.0, 25.0]), np.full((2, 3), sign * 90.0))
    assert roll.soc[0, -1] == pytest.approx(end, abs=1e-9)
    shed = roll.availability_loss_kw[0]
    assert shed[-1] > 80.0
    assert not np.any(roll.availability_loss_kw[1])
    np.testing.assert_allclose(np.abs(roll.delivered_kw[0]) + shed, 90.0, rtol=1e-12)


def test_an_empty_string_delivers_nothing_and_its_inverter_is_off(system: bess.System) -> None:
    roll = bess.rollout(system, bess.State([0.0, 0.5], [25.0, 25.0]), [[50.0], [0.0]])
    assert roll.delivered_kw[0, 0] == 0.0
    assert roll.inverter_loss_kw[0, 0] == 0.0
    assert roll.availability_loss_kw[0, 0] == 50.0


def test_a_full_string_that_is_charged_takes_its_no_load_loss_at_most(system: bess.System) -> None:
    roll = bess.rollout(system, bess.State([1.0, 0.5], [25.0, 25.0]), [[-50.0], [0.0]])
    no_load_kw = 0.012 * 92.0
    assert no_load_kw < -roll.delivered_kw[0, 0] < 1.02 * no_load_kw
    np.testing.assert_allclose(-roll.delivered_kw[0, 0], roll.inverter_loss_kw[0, 0], rtol=1e-12)
    assert roll.soc[0, 0] == 1.0


def test_charging_below_the_no_load_loss_draws_on_the_battery_unless_it_is_empty(system: bess.System) -> None:
    roll = bess.rollout(system, bess.State([0.5, 0.0], [25.0, 25.0]), [[-0.5], [-0.5]])
    assert roll.current_a[0, 0] > 0.0
    assert roll.soc[0, 0] < 0.5
    assert roll.availability_loss_kw[1, 0] == 0.5
    assert roll.soc[1, 0] == 0.0


def test_derating_takes_its_share_of_the_request(system: bess.System) -> None:
    roll = bess.rollout(system, bess.State([0.5, 0.5], [50.0, 60.0]), [[40.0], [40.0]])
    np.testing.assert_allclose(roll.derating_loss_kw[:, 0], [40.0 * (1.0 - 0.772), 40.0], rtol=1e-12)
    np.testing.assert_allclose(roll.delivered_kw[:, 0], [40.0 * 0.772, 0.0], rtol=1e-12)


def test_resistance_jumps_by_its_soc_factor_at_the_switch_and_not_above_it(system: bess.System) -> None:
    soc, temperature = np.array([[0.05], [0.10]]), np.full((2, 1), 45.0)
    _, resistance = _core.ControlModel(system.core).coefficients(soc, temperature, True)
    hot = 1.538e-3 * 192 / 4
    np.testing.assert_allclose(resistance[:, 0], [hot * 10.0 / 2.5, hot], rtol=1e-12)


def test_a_discharge_has_a_real_root_at_the_lowest_soc(system: bess.System) -> None:
    document = copy.deepcopy(system.document)
    document["battery"]["cells_parallel"] = 1
    weak = bess.System(document)
    roll = bess.rollout(weak, bess.State([0.03, 0.03], [25.0, 25.0]), np.full((2, 1), 92.0), dt_h=0.01)
    v, r = _core_coefficients(weak, 0.03)
    assert roll.availability_loss_kw[0, 0] > 0.0
    assert roll.current_a[0, 0] == pytest.approx(v / (2.0 * r), rel=1e-6)
    assert np.all(roll.soc > 0.0)


def test_a_batch_is_the_same_as_its_members(system: bess.System) -> None:
    requests = np.random.default_rng(1).uniform(0.0, 92.0, (3, 4, 2, 5))
    roll = bess.rollout(system, HALF, requests)
    assert roll.soc.shape == requests.shape
    one = bess.rollout(system, HALF, requests[2, 1])
    np.testing.assert_array_equal(roll.soc[2, 1], one.soc)
    np.testing.assert_array_equal(roll.battery_loss_kw[2, 1], one.battery_loss_kw)


def test_largest_power_is_what_a_saturated_string_delivers(system: bess.System) -> None:
    soc, temperature = np.array([0.97, 0.5]), np.array([25.0, 25.0])
    largest = _core.ControlModel(system.core).deliverable_kw(soc, temperature, False, 0.25)
    roll = bess.rollout(system, bess.State(soc, temperature), [[-92.0], [-92.0]])
    np.testing.assert_allclose(largest, -roll.delivered_kw[:, 0], rtol=1e-12)
    assert largest[1] == 92.0


def test_constants_of_normalisation_are_those_of_the_specification(system: bess.System) -> None:
    inverter, battery = _core.ControlModel(system.core).nominal_loss_kw()
    np.testing.assert_allclose(inverter, NOMINAL_LOSS_KW["charge"], rtol=1e-12)
    np.testing.assert_allclose(battery, R_25_OHM * (92e3 / OCV_50_V["discharge"]) ** 2 / 1e3, rtol=1e-12)


def test_greedy_runs_one_inverter_where_only_its_loss_counts_and_both_where_only_heat_does(
    system: bess.System,
) -> None:
    inverter_only = np.array([[1.0, 1.0, 1.0, 0.0]])
    heat_only = np.array([[1.0, 1.0, 0.0, 1.0]])
    one = _horizon(system, HALF, [60.0], inverter_only).greedy()
    both = _horizon(system, HALF, [60.0], heat_only).greedy()
    np.testing.assert_allclose(np.sort(one[:, 0]), [0.0, 60.0])
    np.testing.assert_allclose(both[:, 0], [30.0, 30.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("request_kw", "message"),
    [
        (np.zeros(4), r"shape \(4,\)"),
        (np.zeros((3, 4)), "n_strings = 2"),
        (np.zeros((2, 0)), "at least one step"),
        ([[1.0, math.nan], [0.0, 0.0]], r"request_kw at index \(0, 1\) is nan"),
        ([[1.0], [92.1]], r"string 1, step 0: 92.1 kW is outside \[-92, 92\] kW"),
        ([[0.0, 1.0], [0.0, -1.0]], "step 1 has both signs"),
        ([["a"], ["b"]], "must be an array of numbers"),
    ],
)
def test_bad_requests_are_refused(system: bess.System, request_kw: Any, message: str) -> None:
    with pytest.raises(bess.InputError, match=message):
        bess.rollout(system, HALF, request_kw)


@pytest.mark.parametrize("dt_h", [0.0, -1.0, 25.0, math.nan, math.inf, [0.25, 0.25], "soon"])
def test_bad_step_lengths_are_refused(system: bess.System, dt_h: Any) -> None:
    with pytest.raises(bess.InputError, match="dt_h"):
        bess.rollout(system, HALF, np.zeros((2, 1)), dt_h)


@pytest.mark.parametrize("ambient_c", [math.nan, 200.0, [25.0, 25.0]])
def test_bad_ambient_temperatures_are_refused(system: bess.System, ambient_c: Any) -> None:
    with pytest.raises(bess.InputError, match="ambient_c"):
        bess.rollout(system, HALF, np.zeros((2, 1)), ambient_c=ambient_c)


def test_a_state_that_does_not_fit_is_refused(system: bess.System) -> None:
    with pytest.raises(bess.InputError, match="3 strings"):
        bess.rollout(system, bess.State([0.5] * 3, [25.0] * 3), np.zeros((2, 1)))
    with pytest.raises(bess.InputError, match=r"bess\.State"):
        bess.rollout(system, (0.5, 25.0), np.zeros((2, 1)))  # type: ignore[arg-type]


def test_a_demand_above_the_limits_is_refused_by_the_core(system: bess.System) -> None:
    with pytest.raises(ValueError, match="step 0: demand of 185000 W is above the sum of the limits"):
        _horizon(system, HALF, [185.0])


def test_requests_against_the_demand_or_above_a_limit_are_refused_by_the_core(system: bess.System) -> None:
    horizon = _horizon(system, HALF, [50.0])
    for request in ([[[-1.0], [51.0]]], [[[93.0], [0.0]]], [[[math.nan], [50.0]]]):
        with pytest.raises(ValueError, match="request"):
            horizon.evaluate(np.array(request))


def _core_coefficients(system: bess.System, soc: float) -> tuple[float, float]:
    states = np.full((2, 1), soc), np.full((2, 1), 25.0)
    voltage_v, resistance_ohm = _core.ControlModel(system.core).coefficients(*states, True)
    return float(voltage_v[0, 0]), float(resistance_ohm[0, 0])


def _horizon(
    system: bess.System, state: bess.State, demand_kw: list[float], weights: Any = None
) -> _core.ControlHorizon:
    """One group of equal costs, or of the given weights."""
    n = len(demand_kw)
    costs = np.ones((1, 2, 4)) if weights is None else np.repeat(weights[:, None, :], 2, axis=1)
    return _core.ControlHorizon(
        _core.ControlModel(system.core),
        state.soc,
        state.temperature_c,
        np.array(demand_kw),
        np.full(n, 25.0),
        0.25,
        np.full((2, n), 92.0),
        costs,
        costs,
        np.array([1e-6]),
        np.array([1e-4]),
    )


@pytest.mark.parametrize("min_power_kw", [0.24353825567371942, 0.11273066557310799])
def test_a_request_of_the_minimum_power_is_delivered(system: bess.System, min_power_kw: float) -> None:
    document = copy.deepcopy(system.document)
    document["inverter"]["min_power_kw"] = min_power_kw
    roll = bess.rollout(bess.System(document), HALF, [[min_power_kw], [0.0]])
    assert roll.delivered_kw[0, 0] == min_power_kw
