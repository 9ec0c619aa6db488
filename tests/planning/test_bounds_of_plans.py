"""Claims about `bess.plan_power`: no bound is above a schedule that exists, and plans come close to it."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import DT_H, ENERGY, case

import bess
from bess.control.planning import Plan

BLOCKS = [
    (10, -78),
    (2, -30),
    (2, 0),
    (19, 78),
    (3, 30),
    (2, 0),
    (20, -78),
    (3, -30),
    (2, 0),
    (19, 78),
    (3, 30),
]
TWO_CYCLES_KW = np.concatenate([np.full(n, kw, dtype=float) for n, kw in [*BLOCKS, (2, 0), (8, -78), (1, 0)]])
"""A day of the bundled profile of two strings at rated demand."""


def cost_kwh(
    system: bess.System, state: bess.State, request_kw: np.ndarray, goals: bess.Objectives, model: str
) -> np.ndarray:
    """Cost of schedules `(..., M, T)`: shortfall x undelivered + losses + starts."""
    roll = bess.rollout(system, state, request_kw, DT_H, model=model)
    undelivered = roll.availability_loss_kw + roll.derating_loss_kw
    losses = roll.inverter_loss_kw + roll.battery_loss_kw
    on = roll.delivered_kw != 0.0
    before = np.concatenate([np.zeros_like(on[..., :1]), on[..., :-1]], axis=-1)
    starts = (on & ~before).sum(axis=(-2, -1))
    energy = DT_H * (goals.shortfall * undelivered + losses).sum(axis=(-2, -1))
    return np.asarray(energy + (goals.start_kwh or 0.0) * starts)


def test_a_search_bound_that_the_plan_refutes_gives_way_to_the_proven_one() -> None:
    """Its grid interpolates a derating below which the string cools at once: 4.0 kWh, the plan costs 2.6."""
    plan = bess.plan_power(
        bess.System.reference(n_strings=1),
        bess.State([0.79], [44.9]),
        [-7.0, 24.0, -38.0, -35.0],
        bess.Objectives.energy(shortfall=10.0, start_kwh=0.0),
        dt_h=0.5,
        ambient_c=12.0,
    )
    assert plan.search_bound == plan.bound < plan.cost
    assert 0.0 < plan.search_gap == plan.gap < 0.01


def test_the_search_bound_of_a_cool_plant_that_becomes_full_is_not_refuted() -> None:
    """Where end temperatures of moves were looked up in one go, it was 2.8 % above the cost of the plan."""
    demand_kw = np.repeat([-146.0, 13.0, -32.0, 80.0, -61.0], [7, 6, 8, 10, 1])
    state = bess.State([0.79, 0.71, 0.7], [12.9, 18.5, 16.6])
    plan = bess.plan_power(bess.System.reference(3), state, demand_kw, ambient_c=12.0)
    assert 1.1 * plan.bound < plan.search_bound < plan.cost


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n_strings=st.integers(1, 4), n_steps=st.integers(1, 12))
def test_no_proven_bound_is_above_a_random_schedule(seed: int, n_strings: int, n_steps: int) -> None:
    problem = case(seed, n_strings, n_steps)
    if not problem.limit_kw.any():
        return
    plan = bess.plan_power(
        problem.system, problem.state, problem.demand_kw, dt_h=DT_H, limit_kw=problem.limit_kw
    )
    asked_kw = np.abs(plan.request_kw.sum(axis=0))
    share = np.random.default_rng(seed).dirichlet(np.ones(n_strings), (40, n_steps)).transpose(0, 2, 1)
    wanted = np.minimum(share * asked_kw, problem.limit_kw)
    for m in range(n_strings):  # what is left goes to the first with room
        rest = asked_kw - wanted.sum(axis=1)
        wanted[:, m] += np.clip(rest, 0.0, problem.limit_kw[m] - wanted[:, m])
    costs = cost_kwh(
        problem.system, problem.state, np.sign(problem.demand_kw) * wanted, bess.Objectives.energy(), "start"
    )
    assert not plan.bound > costs.min() * (1.0 + 1e-9) + 1e-9  # NaN: none
    assert plan.cost <= plan.rule_cost


@pytest.mark.exhaustive
@pytest.mark.parametrize("soc", [(0.5, 0.5), (0.12, 0.4), (0.9, 0.97)])
def test_a_short_plan_is_the_best_of_all_schedules_and_its_bounds_are_below(soc: tuple[float, float]) -> None:
    """Two strings, five steps, 11 shares in each: all 161,051 schedules."""
    system, state, goals = (
        bess.System.reference(2),
        bess.State(list(soc), [25.0, 30.0]),
        bess.Objectives.energy(),
    )
    demand_kw = np.array([60.0, 60.0, -40.0, -40.0, 90.0])
    plan = bess.plan_power(system, state, demand_kw, goals, DT_H)
    shares = np.array(list(itertools.product(np.linspace(0.0, 1.0, 11), repeat=5)))
    schedules = np.stack([shares * demand_kw, (1.0 - shares) * demand_kw], axis=1)
    best = cost_kwh(system, state, schedules, goals, "midpoint").min()
    assert plan.cost <= best * 1.001
    assert plan.search_bound <= best * 1.005
    assert plan.bound <= cost_kwh(system, state, schedules, goals, "start").min()


@pytest.mark.parametrize(
    ("n_strings", "soc", "demand_kw"),
    [
        (2, 0.5, [184.0]),  # all inverters at nominal power, between two nodes of the grid
        (1, 0.157, [-73.6] * 6 + [-9.1]),  # a request below the first node
        (1, 0.5, [73.6, 0.5]),
        (4, 0.5, [368.0, -300.0, 3.0]),
    ],
)
def test_the_search_bound_knows_requests_between_the_nodes_of_its_grid(
    n_strings: int, soc: float, demand_kw: list[float]
) -> None:
    system = bess.System.reference(n_strings)
    plan = bess.plan_power(system, bess.State([soc] * n_strings, [25.0] * n_strings), demand_kw)
    assert 0.95 * plan.cost < plan.search_bound < 1.01 * plan.cost


@pytest.mark.parametrize(
    ("soc", "dt_h", "demand_kw", "has_bound"),
    [
        (0.5, 0.25, [-184.0] * 8, False),
        (0.5, 0.25, [-120.0] * 8, True),
        (0.5, 0.25, [184.0] * 8, True),
        (0.02, 1.0, [-160.0] * 2, False),
        (0.0, 0.25, [-160.0] * 2, False),
        (0.2, 1.0, [-160.0] * 2, False),
    ],
)
def test_a_plan_has_no_bound_above_its_cost(
    soc: float, dt_h: float, demand_kw: list[float], has_bound: bool
) -> None:
    """The bound takes the coefficients of the start of each step, the cost those of the middle."""
    plan = bess.plan_power(
        bess.System.reference(2), bess.State([soc] * 2, [25.0] * 2), demand_kw, ENERGY, dt_h
    )
    assert plan.bound <= plan.cost if has_bound else np.isnan(plan.bound) and np.isnan(plan.gap)


def test_a_day_at_rated_demand_is_planned_to_three_per_cent() -> None:
    for n_strings in (2, 4):
        demand_kw = TWO_CYCLES_KW * n_strings / 2
        state = bess.State([0.5] * n_strings, [25.0] * n_strings)
        plan = bess.plan_power(bess.System.reference(n_strings), state, demand_kw)
        assert 0.0 <= plan.search_gap <= 0.03
        assert plan.gap <= 0.06
        assert plan.bound <= plan.search_bound
        assert plan.cost < plan.rule_cost


def test_a_hot_day_without_a_shortage_has_a_rigorous_gap_of_an_eighth() -> None:
    """With undelivered energy at its full price the errors of the proof are twice as large (19 %)."""
    state = bess.State([0.5, 0.5], [38.0, 38.0])
    plan = bess.plan_power(bess.System.reference(2), state, TWO_CYCLES_KW, ambient_c=38.0)
    assert 0.0 < plan.gap < 0.125


def test_a_price_of_starts_reduces_starts() -> None:
    system, state = bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0])
    starts = []
    for start_kwh in (0.0, 0.5):
        goals = bess.Objectives.energy(start_kwh=start_kwh)
        on = bess.plan_power(system, state, TWO_CYCLES_KW, goals).request_kw != 0.0
        starts.append(int((on[:, 1:] & ~on[:, :-1]).sum()))
    assert starts[1] < 0.5 * starts[0]


def test_a_plant_of_twice_the_size_has_the_same_plan_twice() -> None:
    """The default price of a start was 0.15 kWh for inverters of any size."""
    system, state = bess.System.reference(2), bess.State([0.4, 0.6], [25.0, 31.0])
    document = copy.deepcopy(bess.System.reference(2).document)
    document["battery"]["cells_parallel"] *= 2
    document["inverter"]["nominal_kw"] *= 2.0
    document["thermal"]["spatial"]["packs_per_string"] *= 2
    document["thermal"]["lumped"]["k1_k_per_j"] /= 2.0
    large = bess.System(document)
    plan, twice = (
        bess.plan_power(each, state, demand_kw)
        for each, demand_kw in ((system, TWO_CYCLES_KW), (large, 2.0 * TWO_CYCLES_KW))
    )
    np.testing.assert_allclose(twice.request_kw, 2.0 * plan.request_kw, rtol=1e-6, atol=1e-6)
    assert twice.cost == pytest.approx(2.0 * plan.cost, rel=1e-6)
    given = bess.Objectives.energy(start_kwh=0.15)
    assert given.for_inverters(large.nominal_kw).start_kwh == 0.15


def test_starts_that_no_schedule_avoids_are_in_the_proven_bound() -> None:
    system, state = bess.System.reference(1), bess.State([0.5], [25.0])
    free, priced = (
        bess.plan_power(system, state, [50.0, 0.0] * 3, bess.Objectives.energy(start_kwh=start_kwh))
        for start_kwh in (0.0, 2.0)
    )
    assert priced.cost == pytest.approx(free.cost + 3 * 2.0)
    assert free.bound + 0.95 * 3 * 2.0 < priced.bound < priced.cost


def test_plan_power_takes_one_sum_in_kwh() -> None:
    with pytest.raises(bess.InputError, match="plan_power minimises one sum in kWh"):
        bess.plan_power(
            bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0]), [50.0], bess.Objectives()
        )
    with pytest.raises(bess.InputError, match='start_kwh is for kind = "energy"'):
        bess.Objectives(start_kwh=0.1)


@pytest.mark.parametrize(("n_steps", "dt_h"), [(32, 0.25), (4, 1 / 60), (17, 1 / 60), (6, 1.0)])
def test_the_search_bound_of_a_low_demand_is_near_the_optimum(n_steps: int, dt_h: float) -> None:
    """A single string has one schedule, the optimum; its step is less than a cell of SOC."""
    system, state = bess.System.reference(1), bess.State([0.5], [25.0])
    plan = bess.plan_power(system, state, [6.0] * n_steps, ENERGY, dt_h)
    assert plan.cost * 0.99 <= plan.search_bound <= plan.cost * 1.07


def test_a_negative_cost_has_no_relative_gap() -> None:
    """The credit for stored charge exceeds the losses; 0 would state an optimum."""
    nothing = np.zeros((1, 1))
    plan = Plan(nothing, -2.0, -1.0, nothing[0], rollouts=1, bound=-5.0, search_bound=-3.0)
    assert np.isnan(plan.gap) and np.isnan(plan.search_gap)


def test_a_plan_without_demand_has_no_cost_and_no_gap() -> None:
    plan = bess.plan_power(bess.System.reference(2), bess.State([0.5, 0.5], [25.0, 25.0]), [0.0] * 4)
    assert plan.cost == plan.gap == plan.search_gap == 0.0
