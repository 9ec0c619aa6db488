"""Claims about the control model and its bounds on random systems, states and schedules."""

from __future__ import annotations

import numpy as np
import pytest
from control_cases import AMBIENT_C, CORNERS, DT_H, case, points, sheds
from control_oracle import rollout as oracle
from hypothesis import example, given, settings
from hypothesis import strategies as st

import bess

SEEDS = st.integers(0, 2**32 - 1)
corners = pytest.mark.parametrize("corner", sorted(CORNERS))


@pytest.mark.independent
@corners
@pytest.mark.parametrize("like", [True, False])
@settings(max_examples=25, deadline=None)
@given(seed=SEEDS)
def test_rollout_equals_an_independent_reading_of_the_specification(
    corner: str, like: bool, seed: int
) -> None:
    problem = case(seed, corner, n_strings=3, n_steps=5, like=like)
    (request,) = problem.random_requests(np.random.default_rng(seed), 1)
    roll = bess.rollout(problem.system, problem.state, request, DT_H)
    expected = oracle(problem.system, problem.state, request, DT_H, AMBIENT_C)
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(roll, name), values, rtol=1e-7, atol=2e-5, err_msg=name)


@corners
@settings(max_examples=25, deadline=None)
@given(seed=SEEDS)
def test_losses_are_not_negative_and_delivered_plus_lost_is_requested(corner: str, seed: int) -> None:
    problem = case(seed, corner, n_strings=3, n_steps=8)
    requests = problem.random_requests(np.random.default_rng(seed), 4)
    roll = bess.rollout(problem.system, problem.state, requests, DT_H)
    for name in ("availability", "derating", "inverter", "battery"):
        assert np.all(getattr(roll, f"{name}_loss_kw") >= 0.0), name
    total = np.abs(roll.delivered_kw) + roll.availability_loss_kw + roll.derating_loss_kw
    np.testing.assert_allclose(total, np.abs(requests), atol=1e-9)
    for string, soc in zip(problem.system.strings, np.moveaxis(roll.soc, -2, 0), strict=True):
        assert np.all((soc >= string.battery.soc_min) & (soc <= string.battery.soc_max))


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_strings_do_not_depend_on_their_order_or_on_the_rest_of_a_batch(seed: int) -> None:
    problem = case(seed, "regular", n_strings=4, n_steps=6, like=True)
    requests = problem.random_requests(np.random.default_rng(seed), 3)
    order = np.random.default_rng(seed).permutation(4)
    roll = bess.rollout(problem.system, problem.state, requests, DT_H)
    moved = bess.State(problem.state.soc[order], problem.state.temperature_c[order])
    for name in bess.Rollout.__dataclass_fields__:
        values = getattr(roll, name)
        permuted = getattr(bess.rollout(problem.system, moved, requests[:, order], DT_H), name)
        alone = getattr(bess.rollout(problem.system, problem.state, requests[1], DT_H), name)
        np.testing.assert_array_equal(permuted, values[:, order])
        np.testing.assert_array_equal(alone, values[1])


@corners
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_objectives_are_the_costs_of_the_rollout(corner: str, seed: int) -> None:
    problem = case(seed, corner, n_strings=3, n_steps=5)
    requests = problem.random_requests(np.random.default_rng(seed), 4)
    roll = bess.rollout(problem.system, problem.state, requests, DT_H)
    costs = problem.cost_by_group(roll, slice(0, 4)).sum(axis=-1)
    np.testing.assert_allclose(problem.horizon.evaluate(requests), costs, rtol=1e-12, atol=1e-15)


@corners
@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_reachable_boxes_contain_every_rollout(corner: str, seed: int) -> None:
    problem = case(seed, corner, n_strings=3, n_steps=8)
    requests = problem.random_requests(np.random.default_rng(seed), 12)
    roll = bess.rollout(problem.system, problem.state, requests, DT_H)
    states = problem.horizon.reachable()
    assert np.all((roll.soc >= states.soc_low[:, 1:]) & (roll.soc <= states.soc_high[:, 1:]))
    assert np.all(roll.temperature_c >= states.temperature_low_c[:, 1:])
    assert np.all(roll.temperature_c <= states.temperature_high_c[:, 1:])


@corners
@pytest.mark.parametrize("weights", [(1, 1, 1, 1), (1, 1, 1, 0), (1, 1, 0, 1), (1, 0, 1, 1)])
@pytest.mark.parametrize("n_strings", [2, 5])
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_no_decision_of_a_step_costs_less_than_its_cut(
    corner: str, weights: tuple[float, float, float, float], n_strings: int, seed: int
) -> None:
    problem = case(seed, corner, n_strings=n_strings, n_steps=6, weights=weights)
    requests = problem.random_requests(np.random.default_rng(seed), 30)
    roll = bess.rollout(problem.system, problem.state, requests, DT_H)
    boxes = problem.horizon.reachable()
    shed = roll.availability_loss_kw.sum(axis=-2)
    cost = problem.cost_by_group(roll, slice(1, 4))[:, 1]
    for budget_kw in (np.inf, 5.0):
        cuts = problem.horizon.step_bounds(boxes, problem.costs[1], np.full(6, budget_kw))
        assert np.all(cost + cuts.shed_slope * shed >= cuts.phi - 1e-12)
        assert np.any(cuts.phi > 0.0)


@corners
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_cuts_at_frozen_states_hold_for_every_decision_from_these_states(corner: str, seed: int) -> None:
    problem = case(seed, corner, n_strings=3, n_steps=1)
    requests = problem.random_requests(np.random.default_rng(seed), 300)
    roll = bess.rollout(problem.system, problem.state, requests, DT_H)
    soc, temperature = problem.state.soc[:, None], problem.state.temperature_c[:, None]
    cuts = problem.horizon.step_bounds(points(soc, temperature), problem.costs[1], np.full(1, np.inf))
    shed = roll.availability_loss_kw.sum(axis=-2)
    assert np.all(problem.cost_by_group(roll, slice(1, 4))[:, 1] + cuts.shed_slope * shed >= cuts.phi - 1e-12)


@pytest.mark.parametrize("weights", [(1, 1, 1, 1), (1, 1, 1, 1e-3), (1, 1, 1e-3, 1)])
@pytest.mark.parametrize("corner", ["regular", "hot"])
@pytest.mark.parametrize("n_strings", [2, 3, 8])
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_frozen_cuts_add_up_to_the_greedy_objective_where_nothing_is_shed(
    weights: tuple[float, float, float, float], corner: str, n_strings: int, seed: int
) -> None:
    # A string that derates may shed less than its least power, whatever that saves: next to nothing of it.
    problem = case(seed, corner, n_strings, 4, weights, like=True, load=(0.05, 0.85), min_power_kw=1e-9)
    request = problem.horizon.greedy()
    (objectives,) = problem.horizon.evaluate(request[None])
    roll = bess.rollout(problem.system, problem.state, request, DT_H)
    soc = np.concatenate([problem.state.soc[:, None], roll.soc[:, :-1]], axis=1)
    temperature = np.concatenate([problem.state.temperature_c[:, None], roll.temperature_c[:, :-1]], axis=1)
    cuts = problem.horizon.step_bounds(points(soc, temperature), problem.costs[1], np.zeros(4))
    phi, best = cuts.phi, cuts.request_kw
    assert objectives[0] == 0.0
    np.testing.assert_allclose(phi.sum(), objectives[1], rtol=1e-5)
    np.testing.assert_allclose(best.sum(axis=0), problem.demand_kw, rtol=1e-9)
    if corner == "regular":
        np.testing.assert_allclose(problem.horizon.evaluate(best[None])[0], objectives, rtol=1e-5, atol=1e-12)


@corners
@pytest.mark.parametrize("weights", [(1, 1, 1, 1), (1, 1, 1, 0), (1, 1, 0, 1), (1, 0, 1, 1)])
@pytest.mark.parametrize(("n_strings", "turns"), [(2, False), (2, True), (4, True)])
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
@example(seed=307)  # a string that derates sheds a request of 1 W, the least power
def test_no_schedule_leaves_the_tightened_states_and_costs_less_than_a_known_one(
    corner: str, weights: tuple[float, float, float, float], n_strings: int, turns: bool, seed: int
) -> None:
    problem = case(seed, corner, n_strings, 6, weights, like=seed % 2 == 0, turns=turns)
    rng = np.random.default_rng(seed)
    far = problem.random_requests(rng, 40)
    start = problem.horizon.split(far[0], 2000).incumbent.request_kw
    share = rng.uniform(0.0, 0.2, (40, 1, 1))
    near = problem.set_points((1.0 - share) * start + share * problem.random_requests(rng, 40))
    schedules = np.concatenate([start[None], near, far])
    roll = bess.rollout(problem.system, problem.state, schedules, DT_H)
    cost = problem.cost_by_group(roll, slice(0, 4))[:, 1].sum(axis=-1)
    shed = roll.availability_loss_kw.sum(axis=(-2, -1))
    for known in (0, 5, 30, 45):
        bound, boxes, may_shed = problem.horizon.tighten(schedules[known], problem.costs[1], shed[known])
        allowed = shed <= shed[known]
        assert np.all(cost[allowed] >= bound)
        no_worse = allowed & (cost <= cost[known])
        assert no_worse[known]
        assert np.all(roll.soc[no_worse] >= boxes.soc_low[:, 1:])
        assert np.all(roll.soc[no_worse] <= boxes.soc_high[:, 1:])
        assert np.all(roll.temperature_c[no_worse] >= boxes.temperature_low_c[:, 1:])
        assert np.all(roll.temperature_c[no_worse] <= boxes.temperature_high_c[:, 1:])
        assert not np.any(sheds(problem.system, roll)[no_worse] & ~may_shed)


def test_where_battery_losses_count_a_good_schedule_confines_the_states_to_a_fraction_of_the_reachable() -> (
    None
):
    problem = case(3, "regular", 2, 8, (1, 1, 0, 1), like=True, load=(0.3, 0.6))
    known = problem.horizon.greedy()
    bound, tightened, _ = problem.horizon.tighten(known, problem.costs[1], 0.0)
    objective = problem.horizon.evaluate(known[None])[0, 1]
    assert bound >= 0.999 * objective
    for name in ("soc_{}", "temperature_{}_c"):
        width, reachable = (
            (getattr(boxes, name.format("high")) - getattr(boxes, name.format("low")))[:, -1]
            for boxes in (tightened, problem.horizon.reachable())
        )
        assert np.mean(width / reachable) < 0.2


@corners
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
@example(4095526270)  # A request at a limit whose conversion to kW and back is above the limit.
def test_search_and_greedy_are_feasible_repeatable_and_report_what_evaluate_says(
    corner: str, seed: int
) -> None:
    problem = case(seed, corner, n_strings=3, n_steps=4)
    starts = problem.random_requests(np.random.default_rng(seed), 2)
    horizon = problem.horizon
    found = horizon.split(starts[0], 1500)
    request, objectives = found.incumbent.request_kw, found.incumbent.objectives
    for schedule in (horizon.greedy(), request):
        magnitude = schedule * problem.sign
        np.testing.assert_allclose(magnitude.sum(axis=0), np.abs(problem.demand_kw), rtol=1e-9)
        assert np.all((magnitude >= 0.0) & (magnitude <= problem.limit_kw * (1 + 1e-15)))
    np.testing.assert_array_equal(horizon.evaluate(request[None])[0], objectives)
    np.testing.assert_array_equal(horizon.split(starts[0], 1500).incumbent.request_kw, request)
    tolerance = 1e-7 + 1e-6 * objectives[0]
    # Never worse than where it started; the greedy pass is one of the starts.
    for start in horizon.evaluate(np.stack([starts[0], horizon.greedy()])):
        assert objectives[0] <= start[0] + tolerance
        if start[0] <= objectives[0]:
            assert objectives[1] <= start[1] * (1 + 1e-9) + 1e-12
