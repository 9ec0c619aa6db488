"""Claims about when a plan over prices is made anew."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import bess
from bess.dispatch import Arbitrage, DynamicProgramDispatch, PerfectForecast, PersistenceForecast
from bess.study.demands.planners import AwarePlanner, LinearPlanner, MarketPlan
from bess.study.demands.source import StepInputs
from bess.study.study import Study
from bess.system.terms import SettlementTerms

LOOK_AHEAD, COMPARE = 144, 12
PRICES = 60.0 - 40.0 * np.cos(np.arange(480) * 0.25 * 2 * np.pi / 12.0)
SYSTEM = bess.System.reference(2)


def planner(
    prices: np.ndarray = PRICES, *, perfect: bool = True, replan_steps: int | None = None
) -> AwarePlanner:
    return AwarePlanner(
        DynamicProgramDispatch(SYSTEM, 0.25, SettlementTerms()),
        PerfectForecast(prices) if perfect else PersistenceForecast(prices),
        np.arange(prices.size) // 96,
        0.25,
        look_ahead_steps=LOOK_AHEAD,
        replan_steps=replan_steps,
    )


def now(
    soc: float = 0.5, temperature_c: float = 25.0, limit_kw: tuple[float, float] = (92.0, 92.0)
) -> StepInputs:
    return StepInputs(bess.State([soc] * 2, [temperature_c] * 2), np.array(limit_kw), np.full(480, 25.0))


def as_planned(plan: MarketPlan, age: int) -> StepInputs:
    """The state in which the plan has the plant, both strings alike."""
    dispatch = DynamicProgramDispatch(SYSTEM, 0.25, SettlementTerms())
    grid = np.linspace(0.0, 1.0, 2001)
    limit_kw = np.array([92.0, 92.0])
    energy = [dispatch.condition(bess.State([soc] * 2, [25.0] * 2), limit_kw)[0] for soc in grid]
    soc = float(np.interp(plan.expected_energy_kwh[age - 1], energy, grid))
    return now(soc, float(plan.expected_temperature_c[age - 1]))


def test_a_plan_is_kept_while_all_comes_as_it_counted_on() -> None:
    aware = planner()
    plan = aware.plan(0, now(), 0.0)
    assert not any(aware.is_due(age, as_planned(plan, age), plan) for age in (1, COMPARE - 1, COMPARE))
    assert aware.is_due(LOOK_AHEAD // 6, as_planned(plan, LOOK_AHEAD // 6), plan)


def linear() -> LinearPlanner:
    return LinearPlanner(
        Arbitrage(PerfectForecast(PRICES), np.arange(PRICES.size) // 96, power_kw=184.0, energy_kwh=500.0),
        SYSTEM,
    )


@pytest.mark.parametrize("made", [planner, linear])
def test_an_inverter_that_fails_or_returns_makes_a_new_plan_at_once(
    made: Callable[[], AwarePlanner | LinearPlanner],
) -> None:
    dispatch = made()
    plan = dispatch.plan(0, now(), 0.0)
    assert np.abs(plan.demand_kw).max() > 170.0
    assert dispatch.is_due(1, now(limit_kw=(92.0, 0.0)), plan)
    assert dispatch.is_due(1, now(), replace(plan, limit_kw=np.array([92.0, 0.0])))
    rest = dispatch.plan(1, now(limit_kw=(92.0, 0.0)), 0.0)
    assert 80.0 < np.abs(rest.demand_kw).max() <= 92.0 + 1e-9


def test_a_linear_plan_has_the_energy_of_strings_in_service_only() -> None:
    """One of two strings is full and out: the other cannot sell what it holds, nor store what it could."""
    state = bess.State([0.0, 1.0], [25.0, 25.0])
    out = replace(now(limit_kw=(92.0, 0.0)), state=state)
    plan_kw = linear().plan(0, out, 0.0).demand_kw
    stored_kwh = -np.cumsum(np.where(plan_kw < 0.0, plan_kw * 0.9**0.5, plan_kw / 0.9**0.5)) * 0.25
    assert stored_kwh.min() > -1.0
    assert 200.0 < stored_kwh.max() < SYSTEM.nominal_energy_kwh[0] + 1.0


def test_a_linear_plan_fills_aged_strings_no_further_than_they_hold() -> None:
    aged = bess.State([0.0, 0.0], [25.0, 25.0], soh_capacity=[0.9, 0.7])
    plan_kw = linear().plan(0, replace(now(), state=aged), 0.0).demand_kw
    stored_kwh = -np.cumsum(np.where(plan_kw < 0.0, plan_kw * 0.9**0.5, plan_kw / 0.9**0.5)) * 0.25
    held_kwh = float(SYSTEM.nominal_energy_kwh @ aged.soh_capacity)
    assert 0.99 * held_kwh < stored_kwh.max() < held_kwh + 1.0


@pytest.mark.parametrize("off", [{"soc": 0.1}, {"temperature_c": 5.0}])
def test_a_plant_that_is_elsewhere_makes_a_new_plan_when_it_is_looked_at(off: dict[str, float]) -> None:
    aware = planner()
    plan = aware.plan(0, now(), 0.0)
    there = as_planned(plan, COMPARE).state
    soc, temperature_c = float(there.soc[0]), float(there.temperature_c[0])
    soc += off.get("soc", 0.0) * (1.0 if soc < 0.5 else -1.0)
    elsewhere = now(soc, temperature_c + off.get("temperature_c", 0.0))
    assert aware.is_due(COMPARE, elsewhere, plan)
    assert not aware.is_due(COMPARE - 1, elsewhere, plan)


def test_prices_that_are_foreseen_otherwise_make_a_new_plan() -> None:
    prices = PRICES + 20.0 * (np.arange(480) >= 96)  # yesterday was another day
    aware = planner(prices, perfect=False)
    plan = aware.plan(96, now(), 0.0)
    assert aware.is_due(96 + COMPARE, as_planned(plan, COMPARE), plan)


def test_with_a_period_only_the_period_counts() -> None:
    aware = planner(replan_steps=4)
    plan = aware.plan(0, now(), 0.0)
    assert [aware.is_due(step, now(0.9, 40.0, (92.0, 0.0)), plan) for step in (3, 4, 5, 8)] == [
        False, True, False, True,
    ]  # fmt: skip


def test_a_price_that_comes_otherwise_makes_a_new_plan_at_once() -> None:
    prices = np.round(PRICES) + 20.0 * (np.arange(480) == 98)
    aware = planner(prices, perfect=False)
    plan = aware.plan(96, now(), 0.0)
    assert [aware.is_due(96 + age, now(), plan) for age in (1, 2, 3)] == [False, True, False]


@pytest.mark.parametrize("plan", ["aware", "linear"])
def test_a_period_longer_than_its_plans_is_refused_when_the_study_is_read(plan: str) -> None:
    values = {"demand": {"prices": "p.csv", "plan": plan, "replan_h": 48.0}}
    with pytest.raises(bess.InputError, match="replan_h 48 h must not exceed look_ahead_h 36 h"):
        Study.from_document({"name": "s", **values}, "s.toml")
