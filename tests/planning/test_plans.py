"""Claims about plans of hours or days, on random plants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import DT_H, ENERGY, ROUNDING, Case, by_hand, case, differing

import bess
from bess.control.planning import Plan, Planner, PlanPrices
from bess.control.planning.planner import FIRST_STEP_WEIGHT, TERMINAL_VALUE_FACTOR, rollouts_of
from bess.control.policies import PolicyInput, Settings, build_policy
from bess.system.terms import SettlementTerms

SEEDS = st.integers(0, 2**32 - 1)
NOW = {"first_step_weight": FIRST_STEP_WEIGHT}


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, n_strings=st.integers(1, 6), n_steps=st.integers(1, 40), rollouts=st.integers(0, 30))
def test_a_plan_shares_the_demand_within_limits_and_in_its_direction(
    seed: int, n_strings: int, n_steps: int, rollouts: int
) -> None:
    problem = case(seed, n_strings, n_steps)
    planner = Planner(problem.system, n_steps, DT_H, rollouts=rollouts, proof_cells=20)
    first = problem.plan(planner)
    problem.check(first)
    assert first.cost <= first.rule_cost
    # The next call starts from the plan of this one, for another demand and other limits.
    other = case(seed + 1, n_strings, n_steps)
    moved = type(problem)(
        problem.system, problem.state, other.demand_kw, np.minimum(problem.limit_kw, 40.0), problem.prices
    )
    second = moved.plan(planner)
    moved.check(second)
    assert second.cost <= second.rule_cost


@pytest.mark.independent
@settings(max_examples=12, deadline=None)
@given(seed=SEEDS, n_strings=st.integers(1, 4), n_steps=st.integers(2, 32))
def test_the_cost_of_a_plan_is_that_of_a_roll_out_and_never_above_the_warm_start(
    seed: int, n_strings: int, n_steps: int
) -> None:
    problem = case(seed, n_strings, n_steps)
    planner = Planner(problem.system, n_steps, DT_H, rollouts=15, balance=0.0)
    first = problem.plan(planner)
    assert first.cost == pytest.approx(by_hand(problem, first.request_kw, **NOW), rel=ROUNDING, abs=1e-9)
    # Asked again for what it has planned, one step on; the last step asks for nothing.
    demand = np.append(first.request_kw.sum(axis=0)[1:], 0.0)
    end = TERMINAL_VALUE_FACTOR * planner.state_dict()["start_charge"]
    next_ = replace(problem, demand_kw=demand, limit_kw=problem.later_limit_kw)
    carried = np.append(first.request_kw[:, 1:], np.zeros((n_strings, 1)), axis=1)
    second = next_.plan(planner)
    assert second.cost == pytest.approx(by_hand(next_, second.request_kw, end, **NOW), rel=ROUNDING, abs=1e-9)
    assert second.cost <= by_hand(next_, carried, end, **NOW) * (1.0 + ROUNDING) + 1e-9


@settings(max_examples=8, deadline=None)
@given(seed=SEEDS, n_strings=st.integers(2, 4))
def test_more_roll_outs_are_never_worse_from_the_same_start(seed: int, n_strings: int) -> None:
    """Only effort differs: the first 5 roll-outs of 40 are those of a call with 5.

    Without the starts of the bound, whose ascent depends on the best cost so far.
    """
    problem = case(seed, n_strings, 24)
    planners = [Planner(problem.system, 24, DT_H, rollouts=n, price_passes=0) for n in (0, 5, 40)]
    costs = [problem.plan(planner).cost for planner in planners]
    assert costs[2] <= costs[1] <= costs[0]


def test_a_plan_beats_every_rule_where_charge_is_short() -> None:
    """Two hours of discharge from strings with an hour's worth, then two of charge, and again."""
    system = bess.System.reference(2)
    demand = np.where(np.arange(48) % 16 < 8, 60.0, -60.0)
    state, prices = bess.State([0.3, 0.3], [25.0, 25.0]), PlanPrices.energy(ENERGY, 2, 48)
    plan = Planner(system, 48, DT_H)(state, demand, prices)
    assert plan.cost < 0.9 * plan.rule_cost


def test_calls_repeat_to_the_last_bit_and_continue_from_a_state_dict() -> None:
    problem = case(7, 3, 24)

    def three(planner: Planner) -> list[Plan]:
        return [problem.plan(planner) for _ in range(3)]

    once = Planner(problem.system, 24, DT_H, rollouts=20)
    again = Planner(problem.system, 24, DT_H, rollouts=20)
    both = list(zip(three(once), three(again), strict=True))
    once.advance(problem.demand_kw)
    again.advance(problem.demand_kw)
    resumed = Planner(problem.system, 24, DT_H, rollouts=20)
    resumed.load_state_dict(once.state_dict())
    both += [(problem.plan(once), problem.plan(again)), (problem.plan(once), problem.plan(again))]
    late = [problem.plan(resumed), problem.plan(resumed)]
    both += list(zip(late, [pair[0] for pair in both[-2:]], strict=True))
    for a, b in both:
        np.testing.assert_array_equal(a.request_kw, b.request_kw)
        assert (a.cost, a.rule_cost, a.rollouts) == (b.cost, b.rule_cost, b.rollouts)


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_plans_of_one_minute_steps_are_as_good_as_those_of_quarter_hours(seed: int) -> None:
    """They start from the schedule of the bound in quarter hours. From rules and pairs: up to 26 % more.

    With 155 other seeds the cost is 1.7 % less to 0.4 % more, and the gap as much narrower or wider.
    """
    rng = np.random.default_rng(seed)
    system = bess.System.reference(3)
    power_kw = 0.4 * system.nominal_kw.sum() * rng.choice([-1.0, 0.0, 1.0], 8) * rng.uniform(0.2, 1.0, 8)
    start = bess.State(soc=rng.uniform(0.3, 0.7, 3), temperature_c=rng.uniform(20.0, 35.0, 3))
    minutes = bess.plan_power(system, start, np.repeat(power_kw, 45), dt_h=1.0 / 60.0)
    quarters = bess.plan_power(system, start, np.repeat(power_kw, 3))
    assert minutes.cost <= 1.01 * quarters.cost
    assert minutes.search_gap <= quarters.search_gap + 0.01


def test_effort_is_counted_in_roll_outs() -> None:
    problem = case(3, 4, 48)
    planner = Planner(problem.system, 48, DT_H, rollouts=50)
    first = problem.plan(planner)
    second = replace(problem, limit_kw=problem.later_limit_kw).plan(planner)
    # Five rules, pairs, and strings at prices.
    fresh = 7 * min(600, 4 * 50)
    # The last move of each pair of a start may run over by a roll-out of the pair.
    assert first.rollouts <= 50 + fresh + 40
    assert second.rollouts <= 50 + 20


def test_a_warm_start_without_gains_ends_the_search_early() -> None:
    """Asked for the same again and again, the moves run out; from another state, not yet."""
    demand = np.zeros(48)
    demand[8:16], demand[30:40] = -60.0, 90.0
    problem = Case(
        bess.System.reference(2), bess.State([0.5, 0.45], [25.0, 30.0]), demand,
        np.array([92.0, 92.0]), PlanPrices.energy(ENERGY, 2, 48),
    )  # fmt: skip
    planner = Planner(problem.system, 48, DT_H)
    problem.plan(planner)
    carried = dict(planner.state_dict())
    spent = []
    for turn in range(1, 7):
        # The plan as it is, not moved on by a step.
        planner.load_state_dict(
            carried | {"plan_kw": np.roll(planner.state_dict()["plan_kw"], 1, axis=1), "turn": turn}
        )
        spent.append(problem.plan(planner).rollouts)
    assert max(spent[3:]) < rollouts_of(2) / 2
    other = Case(
        problem.system, bess.State([0.9, 0.05], [25.0, 40.0]), demand, problem.limit_kw, problem.prices
    )
    assert other.plan(planner).rollouts > max(spent[3:])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_plan_of_one_string_is_the_demand(sign: float) -> None:
    system = differing(1, np.random.default_rng(1))
    demand = sign * np.linspace(0.0, system.nominal_kw[0] * 1.2, 12)
    plan = Planner(system, 12, DT_H)(bess.State([0.5], [25.0]), demand, PlanPrices.energy(ENERGY, 1, 12))
    largest = system.nominal_kw[0]
    np.testing.assert_allclose(plan.request_kw[0], np.clip(demand, -largest, largest), rtol=1e-12)
    np.testing.assert_allclose(plan.unmet_kw, np.maximum(np.abs(demand) - largest, 0.0), rtol=1e-12)


def test_a_string_out_of_service_gets_no_request_until_it_returns() -> None:
    system = bess.System.reference(3)
    state = bess.State([0.5, 0.6, 0.4], [25.0, 30.0, 35.0])
    planner = Planner(system, 24, DT_H, rollouts=20)
    prices, demand = PlanPrices.energy(ENERGY, 3, 24), np.full(24, 150.0)
    planner(state, demand, prices)
    out = planner(state, demand, prices, limit_kw=[92.0, 0.0, 92.0])
    assert not np.any(out.request_kw[1])
    np.testing.assert_allclose(out.request_kw.sum(axis=0), 150.0, rtol=1e-12)
    back = planner(state, demand, prices)
    assert np.any(back.request_kw[1])


def test_a_string_is_emptied_before_an_outage_that_is_announced() -> None:
    """Three hours at the power of one inverter need the charge of both strings; the first will be out."""
    system, state = bess.System.reference(2), bess.State([0.6, 0.6], [25.0, 25.0])
    limit = np.full((2, 12), 92.0)
    limit[0, 6:] = 0.0
    plan = bess.plan_power(system, state, np.full(12, 85.0), limit_kw=limit)
    roll = bess.rollout(system, state, plan.request_kw, DT_H, model="midpoint")
    assert not np.any(plan.request_kw[0, 6:])
    assert roll.availability_loss_kw.sum() * DT_H < 1.0
    equal_kw = np.array([[42.5] * 6 + [0.0] * 6, [42.5] * 6 + [85.0] * 6])
    assert bess.rollout(system, state, equal_kw, DT_H).availability_loss_kw.sum() * DT_H > 40.0


def test_limits_of_each_step_that_are_equal_are_those_of_the_whole_plan() -> None:
    system, state = bess.System.reference(3), bess.State([0.5, 0.6, 0.4], [25.0, 30.0, 35.0])
    demand, limit = np.repeat([120.0, -90.0], 8), np.array([92.0, 60.0, 0.0])
    plans = [
        bess.plan_power(system, state, demand, limit_kw=each) for each in (limit, np.tile(limit, (16, 1)).T)
    ]
    np.testing.assert_array_equal(plans[0].request_kw, plans[1].request_kw)
    assert plans[0].bound == plans[1].bound


def test_rules_of_plans_are_the_policies_of_their_names() -> None:
    """Over a single step without a search, a plan is the request of the cheapest policy."""
    won = set()
    for seed in range(120):
        problem = case(seed, 4, 1)
        plan = problem.plan(Planner(problem.system, 1, DT_H, rollouts=0, balance=0.0))
        asked = plan.request_kw.sum(axis=0)
        ambient = np.full(1, problem.system.ambient_c)
        costs, requests = {}, {}
        for name in ("equal", "soc", "temperature", "priority"):
            policy = build_policy(name, problem.system, Settings(DT_H))
            inputs = PolicyInput(problem.state, asked, ambient, problem.limit_kw[:, 0])
            requests[name] = policy(inputs).request_kw[:, None]
            costs[name] = by_hand(problem, requests[name], **NOW)
        best = min(costs, key=lambda name: costs[name])
        assert plan.rule_cost == pytest.approx(costs[best], rel=ROUNDING, abs=1e-9)
        ties = [name for name in costs if costs[name] <= costs[best] * (1.0 + ROUNDING) + 1e-9]
        assert any(np.allclose(plan.request_kw, requests[name], atol=1e-6) for name in ties)
        # What rounding leaves of a demand switches no inverter on.
        assert not np.any((np.abs(plan.request_kw) > 0.0) & (np.abs(plan.request_kw) < 1e-6))
        won |= set(ties) if len(ties) == 1 else set()
    assert won == {"equal", "soc", "temperature", "priority"}


def plan_with(**given: object) -> Plan:
    system = bess.System.reference(2)
    settings = {name: given.pop(name) for name in ("horizon_steps", "rollouts", "dt_h") if name in given}
    planner = Planner(system, **{"horizon_steps": 4, **settings})  # type: ignore[arg-type]
    arguments = {
        "state": bess.State([0.5, 0.5], [25.0, 25.0]),
        "demand_kw": np.full(4, 50.0),
        "prices": PlanPrices.energy(ENERGY, 2, 4),
        **given,
    }
    return planner(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"demand_kw": np.full(5, 50.0)}, "demand_kw has shape"),
        ({"demand_kw": [50.0, np.nan, 50.0, 50.0]}, "demand_kw"),
        ({"ambient_c": [20.0, 20.0]}, "ambient_c"),
        ({"state": bess.State([0.5], [25.0])}, "string"),
        ({"limit_kw": [92.0, 93.0]}, "93 kW"),
        ({"limit_kw": [92.0, -1.0]}, "-1 kW"),
        ({"limit_kw": np.full((2, 3), 92.0)}, "one value for each string"),
        ({"prices": PlanPrices.energy(ENERGY, 2, 5)}, r"prices of losses have shape \(5, 4\)"),
        ({"prices": PlanPrices(np.full((4, 4), np.nan), np.zeros(2))}, "prices of losses"),
        ({"prices": PlanPrices(np.full((4, 4), -1.0), np.zeros(2))}, "prices of losses"),
        ({"prices": PlanPrices(np.ones((4, 4)), np.zeros(3))}, "wear"),
        ({"prices": PlanPrices(np.ones((4, 4)), np.zeros(2), start=-1.0)}, "start"),
        ({"rollouts": -1}, "rollouts = -1"),
        ({"horizon_steps": 0}, "horizon_steps 0 must be"),
        ({"horizon_steps": 10_000}, "horizon_steps 10000 must be"),
        ({"dt_h": np.nan}, "dt_h is nan"),
        ({"dt_h": 24.0}, "too long for the lumped thermal model"),
    ],
)
def test_messages_name_the_invalid_argument(wrong: dict[str, object], says: str) -> None:
    plan_with()
    with pytest.raises(bess.InputError, match=says):
        plan_with(**wrong)


def test_a_call_that_is_refused_changes_nothing() -> None:
    problem = case(11, 2, 8)
    planner = Planner(problem.system, 8, DT_H, rollouts=5)
    problem.plan(planner)
    before = planner.state_dict()
    with pytest.raises(bess.InputError):
        planner(problem.state, problem.demand_kw, PlanPrices.energy(ENERGY, 2, 9))
    after = planner.state_dict()
    assert before["turn"] == after["turn"]
    np.testing.assert_array_equal(before["plan_kw"], after["plan_kw"])


def test_a_plan_in_money_keeps_charge_for_the_expensive_hour() -> None:
    """One string is all but empty: asked for the cheap hour it fails, and the other keeps what it has."""
    system = bess.System.reference(2)
    price, demand = np.repeat([20.0, 400.0], 4), np.full(8, 80.0)
    state = bess.State([0.02, 0.4], [25.0, 25.0])
    prices = PlanPrices.money(bess.Objectives.money(), SettlementTerms(), demand, price, np.zeros(2))
    np.testing.assert_allclose(prices.losses[:, 0], (price + 50.0) / 1000.0)
    assert np.all(prices.losses[:, 2:] > 0.0)

    def missing_late_kwh(prices: PlanPrices) -> float:
        plan = Planner(system, 8, DT_H)(state, demand, prices)
        roll = bess.rollout(system, state, plan.request_kw, DT_H, model="midpoint")
        return DT_H * float((roll.availability_loss_kw + roll.derating_loss_kw)[:, 4:].sum())

    assert missing_late_kwh(prices) < 5.0
    assert missing_late_kwh(PlanPrices.energy(ENERGY, 2, 8)) > 20.0


def test_a_start_of_an_inverter_is_paid_once_and_only_where_it_was_off() -> None:
    system, demand = bess.System.reference(2), np.full(8, 40.0)
    state, free = bess.State([0.6, 0.6], [25.0, 25.0]), PlanPrices(np.ones((8, 4)), np.zeros(2))
    dear = PlanPrices(free.losses, free.wear, start=100.0)
    planner = Planner(system, 8, DT_H, rollouts=30, balance=0.0)
    first, second = (planner(state, demand, dear) for _ in range(2))
    assert 100.0 < first.cost < 200.0  # one inverter carries it all
    assert second.cost < 100.0  # and runs already
    running = np.flatnonzero(second.request_kw.any(axis=1))
    assert running.size == 1


def test_forecast_errors_raise_the_relative_error_and_are_forgotten_in_time() -> None:
    """A demand a fifth above its forecast, then a lost inverter, then nothing unforeseen for a week."""
    system, demand = bess.System.reference(2), np.full(8, 60.0)
    planner = Planner(system, 8, DT_H, rollouts=0)
    prices, state = PlanPrices.energy(ENERGY, 2, 8), bess.State([0.5, 0.5], [25.0, 25.0])
    seen = []
    for limit_kw in [[92.0, 92.0]] * 3 + [[92.0, 46.0]]:
        planner(state, np.concatenate([[72.0], demand[1:]]), prices, limit_kw=limit_kw)
        seen.append(planner._forecast_error.relative_error)
    assert seen == pytest.approx([0.0, 12 / 72, 12 / 72, 12 / 72 + 0.25])
    for _ in range(7 * 96):
        planner.advance(demand)
    assert planner._forecast_error.relative_error < 0.2 * seen[-1]


def test_steps_that_are_passed_together_have_the_error_of_those_passed_one_by_one() -> None:
    """Of 150 kW, 92 are delivered: a forecast error until the second string is expected to be out."""
    system, n_steps = bess.System.reference(2), 12
    limit_kw = np.full((2, n_steps), 92.0)
    limit_kw[0, 6:] = 0.0
    rows_kw = np.full((8, n_steps), 150.0)
    rows_kw[:, 0] = 92.0
    errors = []
    for rows in ([rows_kw], np.split(rows_kw, 8)):
        planner = Planner(system, n_steps, DT_H, rollouts=0, proof_cells=None)
        state, prices = bess.State([0.5, 0.5], [25.0, 25.0]), PlanPrices.energy(ENERGY, 2, n_steps)
        planner(state, np.full(n_steps, 60.0), prices, limit_kw=limit_kw)
        for each_kw in rows:
            planner.advance(each_kw)
        errors.append(planner.state_dict()["forecast_error"])
    np.testing.assert_equal(errors[0], errors[1])
    assert planner._forecast_error.relative_error > 0.0


def test_writing_into_a_plan_does_not_change_the_next() -> None:
    """A plan shared its set-points with the warm start of the planner."""
    problem = case(3, 2, 8)
    planners = [Planner(problem.system, 8, DT_H, rollouts=10, price_passes=0, proof_cells=None) for _ in "ab"]
    plans = [problem.plan(planner) for planner in planners]
    plans[0].request_kw[:] = 0.0
    assert problem.plan(planners[0]) == problem.plan(planners[1])


@pytest.mark.parametrize("reactive_kvar", [["a"] * 8, np.ones((2, 8)), [np.nan] * 8, [5.0] * 3])
def test_reactive_power_of_a_plan_is_one_number_for_each_step(reactive_kvar: object) -> None:
    system = bess.System.reference(2)
    planner = Planner(system, 8, rollouts=10, price_passes=0, proof_cells=None)
    prices = PlanPrices.energy(bess.Objectives.energy(), 2, 8)
    with pytest.raises(bess.InputError, match="reactive_kvar"):
        planner(system.initial_state(), [50.0] * 8, prices, reactive_kvar=reactive_kvar)  # type: ignore[arg-type]


@pytest.mark.parametrize("rollouts", ["5", 5.5, -1])
def test_roll_outs_are_a_whole_number(rollouts: int) -> None:
    with pytest.raises(bess.InputError, match=f"rollouts = {rollouts!r}: must be a whole number, at least 0"):
        Planner(bess.System.reference(2), 8, rollouts=rollouts)
