"""Claims: a state of health in the measured state means what the same numbers in a system file mean."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import bess
from bess.control.policies import PolicyInput, Settings, build_policy

SOH_CAPACITY, SOH_RESISTANCE = [0.8, 1.0], [1.5, 1.0]


def states(soc: float = 0.5) -> tuple[bess.State, bess.State]:
    fresh = bess.State([soc, soc], [25.0, 30.0])
    return fresh, bess.State(fresh.soc, fresh.temperature_c, SOH_CAPACITY, SOH_RESISTANCE)


@pytest.fixture(scope="module", params=["reference", "unequal-4"])
def pair(request: pytest.FixtureRequest) -> tuple[bess.System, bess.System]:
    """Two strings, and the same two with the state of health written into the file."""
    system = bess.load_system(request.param)
    overrides: list[dict[str, Any]] = copy.deepcopy(system.document.get("string", [{}, {}]))[:2]
    document = {
        **system.document,
        "system": {**system.document["system"], "n_strings": 2},
        "string": overrides,
    }
    fresh = bess.System(document)
    aged = copy.deepcopy(document)
    for override, string, q, r in zip(
        aged["string"], fresh.strings, SOH_CAPACITY, SOH_RESISTANCE, strict=True
    ):
        battery = override.setdefault("battery", {})
        battery["cell_capacity_ah"] = string.battery.cell_capacity_ah * q
        battery["r_scale"] = string.battery.r_scale * r
    return fresh, bess.System(aged)


@pytest.mark.parametrize("soc", [0.05, 0.5, 0.97])
def test_a_roll_out_from_an_aged_state_is_that_of_an_aged_system(
    pair: tuple[bess.System, bess.System], soc: float
) -> None:
    fresh, aged = pair
    request = np.array([[60.0, 80.0, -70.0, 30.0], [40.0, 10.0, -80.0, 20.0]])
    one, other = states(soc)
    seen, built = bess.rollout(fresh, other, request), bess.rollout(aged, one, request)
    for name in ("delivered_kw", "battery_loss_kw", "soc", "temperature_c", "current_a"):
        np.testing.assert_allclose(getattr(seen, name), getattr(built, name), rtol=1e-9, atol=1e-9)
    assert not np.allclose(seen.soc, bess.rollout(fresh, one, request).soc, rtol=1e-3)


@pytest.mark.parametrize("soc", [0.3, 0.5])
def test_a_split_knows_the_aged_strings(soc: float) -> None:
    system = bess.System.reference()
    _, aged = states(soc)
    goals = bess.Objectives(inverter=0.0)
    demand = [100.0, 60.0, 80.0]
    split = bess.split_power(system, aged, demand, goals)
    again = bess.rollout(system, aged, split.request_kw)
    np.testing.assert_allclose(split.rollout.soc, again.soc)
    assert split.bound <= split.objective + 1e-12
    assert split.gap < 1e-3
    # Where battery losses count, the string of 1.5 times the resistance carries about two thirds.
    assert split.request_kw[0].sum() < 0.67 * split.request_kw[1].sum()


@pytest.mark.parametrize("name", ["soc", "equal"])
def test_rules_ask_no_more_of_an_aged_string_than_it_holds(name: str) -> None:
    system = bess.System.reference()
    _, aged = states(soc=0.06)
    policy = build_policy(name, system, Settings(dt_h=0.25, horizon_steps=1))
    limit = system.nominal_kw
    request = policy(PolicyInput(aged, np.array([95.0]), 25.0, limit)).request_kw
    roll = bess.rollout(system, aged, request[:, None])
    assert roll.availability_loss_kw.max() < 1e-9
    assert request[0] < request[1]


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"soh_capacity": [0.9]}, "soc has 2 strings, soh_capacity has 1"),
        ({"soh_capacity": [0.9, 0.0]}, "string 1: soh_capacity 0 is outside [0.01, 1.5]"),
        ({"soh_resistance": [np.nan, 1.0]}, "string 0: soh_resistance nan is outside [0.1, 100]"),
    ],
)
def test_an_invalid_state_of_health_is_refused(keywords: dict[str, list[float]], message: str) -> None:
    with pytest.raises(bess.InputError) as error:
        bess.State([0.5, 0.5], [25.0, 25.0], **keywords)
    assert message in str(error.value)
