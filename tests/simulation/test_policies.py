"""Claims that hold for every policy in the registry, and what sets each rule apart."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as stn

import bess
from bess.control.policies import POLICIES, PolicyInput, Settings, build_policy
from bess.control.policies.rule import water_fill

SYSTEMS = {n: bess.System.reference(n_strings=n) for n in (1, 2, 3, 5)}
WITHOUT_FILE = [name for name in POLICIES if name != "distilled"]  # that is tried in tests/distil
RULES = [name for name in WITHOUT_FILE if name != "mpc"]
DT_H = 0.25


def policy_input(
    soc: list[float],
    demand_kw: float,
    temperature_c: list[float] | None = None,
    limit_kw: list[float] | None = None,
) -> PolicyInput:
    system = SYSTEMS[len(soc)]
    return PolicyInput(
        state=bess.State(soc, temperature_c or [25.0] * len(soc)),
        demand_kw=np.array([demand_kw, 0.0]),
        ambient_c=25.0,
        limit_kw=system.nominal_kw if limit_kw is None else np.array(limit_kw),
    )


@st.composite
def situations(draw: st.DrawFn) -> PolicyInput:
    n = draw(st.sampled_from(list(SYSTEMS)))
    soc = draw(stn.arrays(float, n, elements=st.floats(0.0, 1.0)))
    temperature_c = draw(stn.arrays(float, n, elements=st.floats(0.0, 70.0)))
    limit_kw = draw(stn.arrays(float, n, elements=st.sampled_from([0.0, 30.0, 92.0])))
    total = float(limit_kw.sum())
    demand_kw = draw(st.floats(-1.0, 1.0)) * total
    return PolicyInput(bess.State(soc, temperature_c), np.array([demand_kw, 0.0]), 25.0, limit_kw)


@pytest.mark.parametrize("name", RULES)
@given(case=situations())
@settings(max_examples=100, deadline=None)
def test_requests_sum_to_the_demand_in_one_direction_within_the_limits(name: str, case: PolicyInput) -> None:
    request_kw = build_policy(name, SYSTEMS[case.state.n_strings], Settings(DT_H))(case).request_kw
    system = SYSTEMS[case.state.n_strings]
    # No set-point is below the least power, so no demand can be met that is.
    min_kw = system.min_power_kw.max()
    met = case.demand_kw[0] if abs(case.demand_kw[0]) >= min_kw else 0.0
    assert request_kw.sum() == pytest.approx(met, abs=1e-9)
    assert ((request_kw == 0.0) | (np.abs(request_kw) >= min_kw)).all()
    assert (np.abs(request_kw) <= case.limit_kw).all()
    assert (request_kw * case.demand_kw[0] >= 0.0).all()


@pytest.mark.parametrize("name", RULES)
@given(case=situations())
@settings(max_examples=100, deadline=None)
def test_no_string_is_overcharged_while_another_could_take_more(name: str, case: PolicyInput) -> None:
    system = SYSTEMS[case.state.n_strings]
    request_kw = np.abs(build_policy(name, system, Settings(DT_H))(case).request_kw)
    state, discharge = case.state, bool(case.demand_kw[0] > 0.0)
    max_kw = system.control_at(state).deliverable_kw(state.soc, state.temperature_c, discharge, DT_H)
    sustainable_kw = np.clip(max_kw, 0.0, case.limit_kw)
    beyond = request_kw > sustainable_kw + 1e-9
    assert not beyond.any() or (request_kw >= sustainable_kw - 1e-9).all()


@pytest.mark.parametrize("name", [rule for rule in RULES if rule != "priority"])
@given(case=situations(), seed=st.integers(0, 2**32 - 1))
@example(case=policy_input([0.0, 0.0], 0.00184, [0.0, 0.0]), seed=3)
@settings(max_examples=50, deadline=None)
def test_permuting_equal_strings_permutes_the_requests(name: str, case: PolicyInput, seed: int) -> None:
    system = SYSTEMS[case.state.n_strings]
    policy = build_policy(name, system, Settings(DT_H))
    order = np.random.default_rng(seed).permutation(case.state.n_strings)
    state = bess.State(case.state.soc[order], case.state.temperature_c[order])
    permuted = PolicyInput(state, case.demand_kw, case.ambient_c, case.limit_kw[order])
    # Powers below the least set-point are added to one string; among equals it is the first in order.
    np.testing.assert_allclose(
        policy(permuted).request_kw,
        policy(case).request_kw[order],
        rtol=1e-12,
        atol=system.n_strings * system.min_power_kw.max(),
    )


@pytest.mark.parametrize("name", WITHOUT_FILE)
def test_an_idle_step_asks_for_nothing_and_needs_no_solve(name: str) -> None:
    policy = build_policy(name, SYSTEMS[2], Settings(DT_H, horizon_steps=2))
    decision = policy(policy_input([0.5, 0.5], 0.0))
    np.testing.assert_array_equal(decision.request_kw, [0.0, 0.0])
    assert decision.solver.status == 0
    assert decision.solver.nodes == 0


@pytest.mark.parametrize("name", WITHOUT_FILE)
def test_a_policy_goes_on_from_its_memory(name: str) -> None:
    cases = [policy_input([0.5, 0.6], demand) for demand in (60.0, 80.0, -40.0)]
    first = build_policy(name, SYSTEMS[2], Settings(DT_H, horizon_steps=2))
    first(cases[0])
    second = build_policy(name, SYSTEMS[2], Settings(DT_H, horizon_steps=2))
    second.load_state_dict(first.state_dict())
    for case in cases[1:]:
        np.testing.assert_array_equal(first(case).request_kw, second(case).request_kw)


def request(name: str, case: PolicyInput) -> list[float]:
    values = build_policy(name, SYSTEMS[case.state.n_strings], Settings(DT_H))(case).request_kw
    return [round(float(value), 9) for value in values]


def test_equal_gives_every_string_the_same() -> None:
    assert request("equal", policy_input([0.3, 0.5, 0.7], -90.0)) == [-30.0, -30.0, -30.0]


def test_equal_gives_what_an_empty_string_cannot_take_to_the_others() -> None:
    assert request("equal", policy_input([0.0, 0.5, 0.7], 90.0)) == [0.0, 45.0, 45.0]


def test_equal_respects_an_inverter_limit() -> None:
    assert request("equal", policy_input([0.5, 0.5], 90.0, limit_kw=[10.0, 92.0])) == [10.0, 80.0]


def test_what_no_string_can_take_is_requested_all_the_same() -> None:
    values = request("equal", policy_input([0.0, 0.0], 60.0))
    assert values == [30.0, 30.0]


def test_priority_fills_one_string_then_the_next() -> None:
    assert request("priority", policy_input([0.5, 0.5, 0.5], 60.0)) == [60.0, 0.0, 0.0]
    assert request("priority", policy_input([0.5, 0.5, 0.5], -120.0)) == [-92.0, -28.0, 0.0]


def test_soc_shares_by_energy_left_in_discharge_and_by_room_in_charge() -> None:
    assert request("soc", policy_input([0.2, 0.6], 80.0)) == [20.0, 60.0]
    assert request("soc", policy_input([0.2, 0.6], -60.0)) == [-40.0, -20.0]


def test_temperature_shares_by_the_distance_from_the_end_of_derating() -> None:
    assert request("temperature", policy_input([0.5, 0.5], 60.0, [50.0, 40.0])) == [20.0, 40.0]
    assert request("temperature", policy_input([0.5, 0.5], 60.0, [62.0, 40.0])) == [0.0, 60.0]


@given(
    total=st.floats(0.0, 500.0),
    weights=stn.arrays(float, 4, elements=st.just(0.0) | st.floats(1e-6, 10.0)),
    caps=stn.arrays(float, 4, elements=st.floats(0.0, 100.0)),
)
def test_water_filling_fills_up_to_the_caps_and_is_proportional_below(
    total: float, weights: np.ndarray, caps: np.ndarray
) -> None:
    powers = water_fill(total, weights, caps)
    assert (powers <= caps).all() and (powers >= 0.0).all()
    assert powers.sum() == pytest.approx(min(total, caps.sum()), abs=1e-9)
    free = (powers < caps) & (weights > 0.0)
    if free.sum() > 1 and powers[free].max() > 0.0:
        ratios = powers[free] / weights[free]
        np.testing.assert_allclose(ratios, ratios[0], rtol=1e-9, atol=1e-12)


def test_an_unknown_policy_is_refused_with_the_ones_there_are() -> None:
    with pytest.raises(bess.InputError, match="allowed: equal, priority, soc, temperature, mpc"):
        build_policy("greedy", SYSTEMS[2], Settings(DT_H))
