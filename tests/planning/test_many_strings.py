"""Claims about plans of many strings: groups, what is shared out, bounds, memory."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from problems import DT_H, ENERGY, ROUNDING, Case, by_hand

import bess
from bess.control.planning import Planner, PlanPrices
from bess.control.planning.groups import MAX_GROUPS, MIN_GROUPS, groups_of

N_STRINGS = MAX_GROUPS + 13
SWINGS = np.where(np.arange(24) % 8 < 4, 1.0, -1.0)


def case(seed: int, n_strings: int = N_STRINGS, n_steps: int = 24) -> Case:
    """Two kinds of strings in states far apart, some limited or out of service, for a while or always."""
    rng = np.random.default_rng(seed)
    document = copy.deepcopy(bess.System.reference(n_strings).document)
    document["string"] = [{"inverter": {"nominal_kw": 60.0}} if m % 3 == 0 else {} for m in range(n_strings)]
    system = bess.System(document, name="two kinds")
    state = bess.State(rng.uniform(0.2, 0.8, n_strings), rng.uniform(20.0, 45.0, n_strings))
    limit = system.nominal_kw * rng.choice([0.0, 0.5, 1.0], n_strings, p=[0.1, 0.1, 0.8])
    limit = limit[:, None].repeat(n_steps, axis=1)
    limit[: n_strings // 5, n_steps // 2 : 3 * n_steps // 4] = 0.0
    demand = SWINGS[:n_steps] * rng.uniform(0.05, 0.6, n_steps) * limit.sum(axis=0)
    return Case(system, state, demand, limit, PlanPrices.energy(ENERGY, n_strings, n_steps))


@pytest.mark.parametrize("seed", range(4))
def test_a_plan_of_groups_shares_out_the_demand_at_the_cost_of_its_true_strings(seed: int) -> None:
    given = case(seed)
    planner = Planner(given.system, 24, DT_H, rollouts=20, balance=0.0, price_passes=0, first_step_weight=1.0)
    plan = given.plan(planner)
    given.check(plan)
    assert plan.cost < plan.rule_cost
    assert plan.cost == pytest.approx(by_hand(given, plan.request_kw), rel=ROUNDING)


def test_a_warm_started_plan_of_groups_never_costs_more_than_its_start() -> None:
    given = case(5)
    planner = Planner(given.system, 24, DT_H, rollouts=10, balance=0.0, price_passes=0, first_step_weight=1.0)
    first = given.plan(planner)
    moved = np.pad(first.request_kw[:, 1:], ((0, 0), (0, 1)))
    planner.rollouts = 0
    last_asks_nothing = replace(
        given, demand_kw=np.append(given.demand_kw[1:], 0.0), limit_kw=given.later_limit_kw
    )
    end = planner.state_dict()["start_charge"] * 0.1
    second = last_asks_nothing.plan(planner)
    assert second.cost <= by_hand(last_asks_nothing, moved, end) * (1.0 + ROUNDING)


def test_the_bound_of_many_strings_is_below_the_schedules_of_plan_and_rules() -> None:
    given = case(6, n_steps=16)
    plan = bess.plan_power(given.system, given.state, given.demand_kw, ENERGY, limit_kw=given.limit_kw)
    assert 0.5 * plan.cost < plan.bound <= plan.cost <= plan.rule_cost
    asked = np.abs(given.demand_kw) / given.limit_kw.sum(axis=0)
    equal = given.limit_kw * np.copysign(asked, given.demand_kw)
    for request_kw in (plan.request_kw, equal):
        roll = bess.rollout(given.system, given.state, request_kw, DT_H)
        shed = roll.availability_loss_kw.sum() + roll.derating_loss_kw.sum()
        lost = roll.inverter_loss_kw.sum() + roll.battery_loss_kw.sum()
        assert plan.bound <= (3.0 * shed + lost) * DT_H


def test_memory_continues_a_plan_of_groups_to_the_same_bits() -> None:
    given = case(7)
    planners = [Planner(given.system, 24, DT_H, rollouts=10, price_passes=0) for _ in range(2)]
    given.plan(planners[0])
    planners[1].load_state_dict(planners[0].state_dict())
    warmer = bess.State(given.state.soc * 0.99, given.state.temperature_c + 1.0)
    later = replace(given, state=warmer, limit_kw=given.later_limit_kw)
    one, other = (later.plan(planner) for planner in planners)
    np.testing.assert_array_equal(one.request_kw, other.request_kw)


def test_groups_contain_similar_strings_in_service() -> None:
    given = case(8, n_strings=200)
    groups = groups_of(given.system, given.state, given.limit_kw)
    assert groups is not None
    np.testing.assert_array_equal(groups < 0, ~given.limit_kw.any(axis=1))
    in_groups = [np.flatnonzero(groups == number) for number in range(MAX_GROUPS)]
    assert groups.max() == MAX_GROUPS - 1
    assert all(np.unique(given.system.nominal_kw[members]).size == 1 for members in in_groups)
    within = np.mean([np.ptp(given.state.soc[members]) for members in in_groups])
    assert within < 0.5 * np.ptp(given.state.soc)


def test_few_strings_are_planned_one_by_one_and_equal_ones_in_groups_of_one_size() -> None:
    system = bess.System.reference(4 * MIN_GROUPS)
    groups = groups_of(system, system.initial_state(), system.nominal_kw[:, None])
    assert groups is not None
    np.testing.assert_array_equal(np.bincount(groups), 4)
    few = bess.System.reference(MIN_GROUPS)
    assert groups_of(few, few.initial_state(), few.nominal_kw[:, None]) is None


def test_strings_that_all_aged_differently_are_planned_in_groups_without_a_bound() -> None:
    n = 100
    system, health = bess.System.reference(n), np.linspace(0.8, 1.0, n)
    state = bess.State(np.full(n, 0.5), np.full(n, 25.0), soh_capacity=health, soh_resistance=2.0 - health)
    planner = Planner(system, 8, rollouts=10)
    plan = planner(state, 30.0 * n * SWINGS[:8], PlanPrices.energy(ENERGY, n, 8))
    assert plan.cost < plan.rule_cost and np.isnan(plan.bound) and np.isnan(plan.search_bound)


def test_strings_far_apart_are_planned_one_by_one_as_long_as_there_are_as_many_groups() -> None:
    system = bess.System.reference(MAX_GROUPS)
    spread = bess.State(np.linspace(0.0, 1.0, MAX_GROUPS), 20.0 + 40.0 * (np.arange(MAX_GROUPS) % 4) / 3)
    assert groups_of(system, spread, system.nominal_kw[:, None]) is None


@pytest.mark.parametrize("n_strings", [40, 120])
def test_many_strings_lose_no_greater_share_than_eight(n_strings: int) -> None:
    def share(n: int, policy: str) -> float:
        values = {
            "run.days": 0.5,
            "system.n_strings": n,
            "demand.scale": n / 2,
            "policy.name": policy,
            "policy.mode": "plan",
            "policy.objectives.kind": "energy",
            "policy.rollouts": 20,
        }
        result = bess.run(bess.load_study("case1", values), progress=False)
        return result.kpis["lost_kwh"] / float(np.abs(result.dataset.demand_kw).sum() * DT_H)

    many = share(n_strings, "mpc")
    assert many < share(8, "mpc") + 0.0015
    assert many < 0.95 * share(n_strings, "soc")
