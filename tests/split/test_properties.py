"""Properties of the power split on random plants, states and demands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bess
from bess.control.problem import SplitProblem
from bess.control.split.warm_start import WarmStart

REFERENCE = bess.System.reference(n_strings=2)


def differing_strings():
    document = bess.System.reference().document
    document["system"]["n_strings"] = 3
    document["string"] = [
        {},
        {"inverter": {"nominal_kw": 60.0}, "battery": {"cells_parallel": 3}},
        {"battery": {"r_scale": 1.5, "soc_min": 0.05, "soc_max": 0.95}},
    ]
    return bess.System(document, name="differing")


DIFFERING = differing_strings()
SPLITTERS = {
    (system.name, steps): bess.PowerSplit(system, steps, node_limit=3)
    for system in (REFERENCE, DIFFERING)
    for steps in (1, 3)
}


@st.composite
def problems(draw):
    system = draw(st.sampled_from([REFERENCE, DIFFERING]))
    steps = draw(st.sampled_from([1, 3]))
    low = [s.battery.soc_min for s in system.strings]
    high = [s.battery.soc_max for s in system.strings]
    soc = [draw(st.floats(a, b)) for a, b in zip(low, high, strict=True)]
    tau = [draw(st.floats(10.0, 58.0)) for _ in low]
    top = 1.2 * system.nominal_kw.sum()
    some = st.one_of(st.just(0.0), st.floats(-top, top), st.floats(-0.1, 0.1))
    demand = [draw(some) for _ in range(steps)]
    return system, bess.State(soc, tau), np.array(demand)


@settings(max_examples=120, deadline=None)
@given(problems())
def test_requests_meet_the_demand_and_every_number_comes_from_their_roll_out(problem):
    system, state, demand = problem
    splitter = SPLITTERS[system.name, demand.size]
    splitter.warm_start = None
    split = splitter(state, demand)
    met = np.sign(demand) * (np.abs(demand) - split.unmet_kw)
    np.testing.assert_allclose(split.request_kw.sum(axis=0), met, atol=1e-6)
    beyond = np.maximum(np.abs(demand) - system.nominal_kw.sum(), 0.0)
    least = system.min_power_kw.min()
    beyond = np.where(np.abs(demand) < least, np.abs(demand), beyond)
    np.testing.assert_allclose(split.unmet_kw, beyond, atol=1e-9)
    assert np.all((split.request_kw == 0.0) | (np.abs(split.request_kw) >= least))
    assert np.all(np.abs(split.request_kw) <= system.nominal_kw[:, None] * (1.0 + 1e-9))

    again = bess.rollout(system, state, split.request_kw)
    np.testing.assert_array_equal(again.soc, split.rollout.soc)
    assert split.availability_loss_kw == again.availability_loss_kw.sum()
    for group in split.groups:
        assert group.bound <= group.objective * (1.0 + 1e-9) + 1e-9
    assert not np.any(split.saturated & (split.rollout.availability_loss_kw == 0.0))


@settings(max_examples=40, deadline=None)
@given(problems())
def test_no_random_split_beats_the_bounds(problem):
    system, state, demand = problem
    splitter = SPLITTERS[system.name, demand.size]
    splitter.warm_start = None
    split = splitter(state, demand)
    met = np.abs(split.request_kw.sum(axis=0))
    rng = np.random.default_rng(0)
    nominal = system.nominal_kw[:, None]
    tried = 0
    for _ in range(200):
        weight = rng.uniform(size=split.request_kw.shape) ** rng.choice([0.2, 1.0, 20.0]) * nominal
        request = weight * met / weight.sum(axis=0)
        if np.any(request > nominal):
            continue
        tried += 1
        losses = bess.rollout(system, state, request * np.sign(demand))
        n = request.size
        shed = losses.availability_loss_kw.sum() / nominal.mean() / n
        assert shed >= split.groups[0].bound - 1e-9
        if shed <= split.groups[0].objective:
            inverter_kw = np.array([s.inverter.loss_charge[-1] for s in system.strings])[:, None] * nominal
            _, battery_kw = system.control_at(system.initial_state()).nominal_loss_kw()
            second = sum(
                x.sum() / scale.mean() / n
                for x, scale in (
                    (losses.derating_loss_kw, nominal),
                    (losses.inverter_loss_kw, inverter_kw),
                    (losses.battery_loss_kw, battery_kw[:, None]),
                )
            )
            assert second >= split.bound * (1.0 - 1e-9) - 1e-9
    assert tried or not met.any() or np.any(met > 0.5 * nominal.sum())


def test_a_splitter_gives_the_same_answer_whatever_it_solved_before():
    fresh, used = bess.PowerSplit(REFERENCE, 3), bess.PowerSplit(REFERENCE, 3)
    used(bess.State([0.02, 0.9], [50.0, 20.0]), [150.0, 20.0, -60.0])
    used.warm_start = None
    state, demand = bess.State([0.08, 0.12], [30.0, 35.0]), [120.0, 90.0, 100.0]
    np.testing.assert_array_equal(fresh(state, demand).request_kw, used(state, demand).request_kw)


@pytest.mark.parametrize(
    ("changes", "goes_on"),
    [
        ({}, True),
        ({"soc": [0.005, 0.0], "temperature_c": 2.0, "demand_kw": [3.0, 0.0, 60.0]}, True),
        ({"soc": [0.0, 0.05]}, False),
        ({"temperature_c": 20.0}, False),
        ({"demand_kw": [-70.0, 0.0, 0.0]}, False),
        ({"limit_kw": -20.0}, False),
    ],
)
def test_a_warm_start_is_valid_if_demand_limits_and_state_are_close_to_the_expected(changes, goes_on):
    def problem(state, demand_kw, limit_kw):
        return SplitProblem.check(REFERENCE, 3, 0.25, state, demand_kw, None, limit_kw)

    change = {"soc": 0.0, "temperature_c": 0.0, "demand_kw": 0.0, "limit_kw": 0.0} | changes
    state, demand_kw, limit_kw = bess.State([0.5, 0.6], [30.0, 31.0]), [100.0, 80.0, 90.0], np.full(2, 92.0)
    split = bess.PowerSplit(REFERENCE, 3)(state, demand_kw, limit_kw=limit_kw)
    carried = WarmStart.after(problem(state, demand_kw, limit_kw), split.request_kw, split.rollout)
    now = bess.State(carried.soc + change["soc"], carried.temperature_c + change["temperature_c"])
    ahead_kw = np.array([80.0, 90.0, 20.0]) + change["demand_kw"]
    assert carried.is_valid_for(problem(now, ahead_kw, limit_kw + change["limit_kw"])) is goes_on


def test_of_unrelated_problems_a_used_splitter_solves_none_worse_than_a_fresh_one():
    rng = np.random.default_rng(7)
    used = bess.PowerSplit(REFERENCE, 4, node_limit=1)
    for _ in range(12):
        near = 10.0 ** rng.uniform(-4.0, -1.0, 2)
        state = bess.State([near, 1.0 - near][rng.integers(2)], rng.uniform(20.0, 50.0, 2))
        demand_kw = rng.choice([-1.0, 1.0]) * rng.uniform(18.0, 184.0, 4)
        fresh = bess.PowerSplit(REFERENCE, 4, node_limit=1)(state, demand_kw)
        np.testing.assert_array_equal(used(state, demand_kw).request_kw, fresh.request_kw)


def test_a_restored_warm_start_resumes_to_the_last_bit():
    first = bess.PowerSplit(REFERENCE, 3)
    state, demand = bess.State([0.3, 0.31], [30.0, 35.0]), np.array([120.0, 90.0, 100.0])
    first(state, demand)
    second = bess.PowerSplit(REFERENCE, 3)
    second.warm_start = first.warm_start
    np.testing.assert_array_equal(first(state, demand).request_kw, second(state, demand).request_kw)


def test_no_demand_needs_no_solve_and_keeps_every_string_off():
    split = bess.split_power(REFERENCE, REFERENCE.initial_state(), [0.0, 0.0])
    assert split.status is bess.SplitStatus.NO_DEMAND
    assert split.nodes == 0
    assert not split.request_kw.any()
    assert (split.gap, split.search_gap, split.objective, split.bound) == (0.0, 0.0, 0.0, 0.0)


def test_demand_above_the_plant_is_split_at_full_power_and_the_rest_is_unmet():
    split = bess.split_power(REFERENCE, REFERENCE.initial_state(), [200.0, -190.0])
    np.testing.assert_allclose(split.request_kw, [[92.0, -92.0], [92.0, -92.0]])
    np.testing.assert_allclose(split.unmet_kw, [16.0, 6.0])


def test_a_string_out_of_service_gets_no_request():
    splitter = bess.PowerSplit(REFERENCE, 2)
    split = splitter(REFERENCE.initial_state(), [50.0, -60.0], limit_kw=[0.0, 92.0])
    np.testing.assert_allclose(split.request_kw, [[0.0, 0.0], [50.0, -60.0]])
    assert not split.inverter_on[0].any()


def test_a_time_limit_of_zero_returns_the_incumbent_with_its_status():
    split = bess.split_power(
        REFERENCE, bess.State([0.05, 0.08], [30.0, 30.0]), [90.0, 80.0, 150.0], time_limit_s=0.0
    )
    assert split.status is bess.SplitStatus.TIME_LIMIT
    assert split.fallback
    np.testing.assert_allclose(split.request_kw.sum(axis=0), [90.0, 80.0, 150.0])
    assert str(split.status).endswith(".")


def test_a_failing_solver_is_flagged_and_the_split_still_meets_the_demand(monkeypatch):
    from bess.control.split.relaxation import conic

    state, demand = bess.State([0.05, 0.08], [30.0, 30.0]), [90.0, 80.0, 150.0]
    solved = bess.split_power(REFERENCE, state, demand)
    failed = conic.ConicSolution(-np.inf)
    monkeypatch.setattr(conic, "solve", lambda *_: failed)
    split = bess.split_power(REFERENCE, state, demand)
    assert split.status is bess.SplitStatus.SOLVER_FAILED
    assert split.fallback
    np.testing.assert_allclose(split.request_kw.sum(axis=0), demand)
    assert split.bound < solved.bound, "what failed proves nothing"


def test_payoff_normalisation_keeps_the_availability_of_the_constant_one():
    demand, goals = [90.0, 60.0, 120.0], bess.Objectives(normalisation="payoff")
    state = bess.State([0.02, 0.1], [40.0, 48.0])
    plain, payoff = (bess.split_power(REFERENCE, state, demand, given) for given in (None, goals))
    assert plain.availability_loss_kw > 100.0
    assert payoff.availability_loss_kw == pytest.approx(plain.availability_loss_kw, rel=1e-3)
    # Where nothing is short, its bound is as tight as that of the constant one.
    assert bess.split_power(REFERENCE, bess.State([0.4, 0.6], [40.0, 48.0]), demand, goals).gap < 1e-3


def test_priorities_decide_which_loss_is_lowest():
    state, demand = bess.State([0.5, 0.5], [25.0, 25.0]), [60.0, 60.0]
    first = bess.Objective(1.0, priority=2)
    inverter = bess.split_power(REFERENCE, state, demand, bess.Objectives(inverter=first))
    battery = bess.split_power(REFERENCE, state, demand, bess.Objectives(battery=first))
    assert inverter.rollout.inverter_loss_kw.sum() < 0.7 * battery.rollout.inverter_loss_kw.sum()
    assert battery.rollout.battery_loss_kw.sum() < 0.6 * inverter.rollout.battery_loss_kw.sum()
