import itertools

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bess.dispatch import Arbitrage, PerfectForecast, PersistenceForecast
from bess.dispatch.arbitrage import calendar_days
from bess.errors import InputError

POWER_KW, ENERGY_KWH = 100.0, 250.0
PRICES = st.lists(st.integers(-200, 400), min_size=1, max_size=24).map(lambda p: np.array(p, dtype=float))


def planner(price, **changes) -> Arbitrage:
    arguments = {
        "power_kw": POWER_KW,
        "energy_kwh": ENERGY_KWH,
        "efficiency": 0.81,
        "cycles_per_day": 2.0,
        "look_ahead_h": 24.0,
        "replan_h": 6.0,
        "dt_h": 1.0,
    } | changes
    days = changes.pop("days", np.zeros(len(price), dtype=int))
    arguments.pop("days", None)
    return Arbitrage(PerfectForecast(price), days, **arguments)


def stored(demand_kw, efficiency=0.81, dt_h=1.0):
    """Change of the stored energy in each step [kWh]."""
    one_way = np.sqrt(efficiency)
    return -np.where(demand_kw > 0, demand_kw / one_way, demand_kw * one_way) * dt_h


def revenue(demand_kw, price, dt_h=1.0):
    return float(demand_kw @ price) * dt_h / 1000.0


def best_by_exhaustion(price, start_kwh, cells, efficiency, cycles, dt_h=1.0):
    """Best revenue over all paths on a grid of stored energy, by dynamic programming."""
    one_way, cell = np.sqrt(efficiency), ENERGY_KWH / cells
    change = np.arange(cells + 1)[None, :] - np.arange(cells + 1)[:, None]
    demand = -np.where(change > 0, change * cell / one_way, change * cell * one_way) / dt_h
    allowed = np.abs(demand) <= POWER_KW * (1 + 1e-12)
    budget = int(cycles * cells + 1e-9)
    value = np.full((cells + 1, budget + 1), -np.inf)
    value[round(start_kwh / cell), 0] = 0.0
    for p in price:
        after = np.full_like(value, -np.inf)
        for e, f in itertools.product(range(cells + 1), repeat=2):
            if allowed[e, f]:
                out = max(0, e - f)
                gained = value[e, : budget + 1 - out] + demand[e, f] * p * dt_h / 1000.0
                after[f, out:] = np.maximum(after[f, out:], gained)
        value = after
    return value.max()


@settings(max_examples=80, deadline=None)
@given(
    price=PRICES,
    start=st.floats(0.0, 1.0),
    efficiency=st.sampled_from([0.5, 0.81, 1.0]),
    cycles=st.sampled_from([0.3, 1.0, 2.0]),
    used=st.floats(0.0, 1.5),
)
@example(price=np.full(24, -50.0), start=1.0, efficiency=0.5, cycles=2.0, used=0.0)
def test_a_plan_keeps_every_limit(price, start, efficiency, cycles, used):
    days = np.arange(price.size) // 10
    plan = planner(price, days=days, efficiency=efficiency, cycles_per_day=cycles).plan(
        0, start * ENERGY_KWH, used * ENERGY_KWH
    )
    assert plan.shape == price.shape
    assert np.abs(plan).max() <= POWER_KW
    assert not ((plan != 0.0) & (np.abs(plan) < 1e-6 * POWER_KW)).any()
    change = stored(plan, efficiency)
    energy = start * ENERGY_KWH + np.cumsum(change)
    assert energy.min() >= -1e-6 * ENERGY_KWH
    assert energy.max() <= ENERGY_KWH * (1 + 1e-6)
    for day in range(days[-1] + 1):
        budget = max(0.0, cycles - used * (day == 0)) * ENERGY_KWH
        assert -change[(days == day) & (change < 0)].sum() <= budget + 1e-5 * ENERGY_KWH


@settings(max_examples=60, deadline=None)
@given(price=PRICES)
def test_a_plan_from_an_empty_storage_never_loses_money(price):
    assert revenue(planner(price).plan(0, 0.0), price) >= -1e-6


@settings(max_examples=25, deadline=None)
@given(
    price=st.lists(st.integers(-100, 300), min_size=2, max_size=6).map(lambda p: np.array(p, dtype=float)),
    start=st.integers(0, 10),
    cycles=st.sampled_from([0.4, 1.0, 5.0]),
)
@pytest.mark.exhaustive
@example(price=np.array([-100.0, -50.0, -100.0, 20.0]), start=10, cycles=5.0)
@example(price=np.array([-1.0, -100.0, -100.0, -100.0, 300.0]), start=8, cycles=5.0)
def test_a_plan_without_losses_equals_exhaustive_search(price, start, cycles):
    """With efficiency 1 all limits are multiples of the grid (25 kWh), so the optimum lies on it."""
    plan = planner(price, efficiency=1.0, cycles_per_day=cycles).plan(0, start * 25.0)
    assert revenue(plan, price) == pytest.approx(
        best_by_exhaustion(price, start * 25.0, 10, 1.0, cycles), abs=2e-3
    )


@pytest.mark.exhaustive
@settings(max_examples=12, deadline=None)
@given(price=st.lists(st.integers(-100, 300), min_size=2, max_size=5).map(lambda p: np.array(p, dtype=float)))
@example(price=np.array([-100.0, -100.0, -100.0, -100.0, 50.0]))
@example(price=np.array([-20.0, -100.0, -100.0, -80.0]))
def test_a_plan_with_losses_equals_exhaustive_search_within_its_grid(price):
    cells = 60
    plan = planner(price, efficiency=0.81, cycles_per_day=1.5).plan(0, ENERGY_KWH / 2)
    best = best_by_exhaustion(price, ENERGY_KWH / 2, cells, 0.81, 1.5)
    grid_error = np.abs(price).sum() * ENERGY_KWH / cells / np.sqrt(0.81) / 1000.0
    assert best - 1e-3 <= revenue(plan, price) <= best + grid_error


@pytest.mark.exhaustive
def test_energy_is_not_dissipated_at_negative_prices():
    """Full, and paid for consuming: doing both at once would earn most, but no plant can."""
    price = np.full(8, -100.0)
    plan = planner(price, efficiency=0.5, cycles_per_day=100.0).plan(0, ENERGY_KWH)
    assert revenue(plan, price) == pytest.approx(
        best_by_exhaustion(price, ENERGY_KWH, 100, 0.5, 100.0), rel=0.02
    )


def test_plans_are_the_same_for_the_same_arguments_so_a_run_can_resume():
    rng = np.random.default_rng(3)
    price = rng.normal(60, 80, 96)
    first, second = planner(price), planner(price)
    second.plan(0, 0.0)
    second.plan(40, 77.0, 10.0)
    assert np.array_equal(first.plan(12, 120.0, 5.0), second.plan(12, 120.0, 5.0))


def test_a_plan_ends_where_the_prices_end():
    arbitrage = planner(np.arange(30.0))
    assert arbitrage.plan(0, 0.0).shape == (24,)
    assert arbitrage.plan(28, 0.0).shape == (2,)
    assert [step for step in range(30) if arbitrage.is_due(step)] == [0, 6, 12, 18, 24]


@pytest.mark.parametrize("energy", [-5.0, 260.0])
def test_a_plant_outside_its_window_is_planned_back_or_left(energy):
    price = np.array([10.0, 200.0, 10.0, 200.0])
    plan = planner(price).plan(0, energy)
    path = energy + np.cumsum(stored(plan))
    assert path.min() >= min(0.0, energy) - 1e-6
    assert path.max() <= max(ENERGY_KWH, energy) + 1e-6


def test_only_price_spreads_above_the_losses_are_traded():
    assert np.abs(planner(np.array([85.0, 100.0])).plan(0, 0.0)).max() < 1e-6
    np.testing.assert_allclose(planner(np.array([75.0, 100.0])).plan(0, 0.0), [-100.0, 81.0], atol=1e-6)


def test_the_cycle_limit_counts_local_days():
    index = pd.date_range("2024-03-30", "2024-04-02", freq="15min", tz="Europe/Berlin", inclusive="left")
    days = calendar_days(index.tz_convert("UTC"), "Europe/Berlin")
    assert np.unique(days, return_counts=True)[1].tolist() == [96, 92, 96]
    price = np.tile([0.0, 0.0, 100.0, 100.0], 12)
    plan = planner(price, days=np.repeat([0, 1], 24), cycles_per_day=0.5, look_ahead_h=48.0).plan(0, 0.0)
    out = -np.minimum(stored(plan), 0.0)
    np.testing.assert_allclose([out[:24].sum(), out[24:].sum()], 0.5 * ENERGY_KWH)


@pytest.mark.parametrize("cycles", [{"cycles_per_day": 1.0}, {"cycles_per_plan": 1.0}])
def test_the_strings_in_service_make_no_cycles_for_those_that_are_out(cycles):
    """Half of the energy is in service: it was discharged twice."""
    price = np.tile([10.0, 10.0, 90.0, 90.0], 6)
    plan = planner(price, efficiency=1.0, **cycles).plan(0, 0.0, available_kwh=ENERGY_KWH / 2.0)
    assert np.maximum(plan, 0.0).sum() == pytest.approx(ENERGY_KWH / 2.0, abs=1e-3)


def test_persistence_of_prices_plans_with_yesterday():
    price = np.r_[np.tile([0.0, 100.0], 12), np.tile([100.0, 0.0], 12)]
    arbitrage = Arbitrage(
        PersistenceForecast(price, dt_h=1.0),
        np.repeat([0, 1], 24),
        power_kw=100.0,
        energy_kwh=250.0,
        dt_h=1.0,
    )
    plan = arbitrage.plan(24, 100.0)
    assert plan[1::2].sum() > 0.0
    assert revenue(plan, price[24:]) < revenue(planner(price).plan(24, 100.0), price[24:])


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"power_kw": 0.0}, "power_kw 0.0 kW must be finite and above 0 kW"),
        ({"power_kw": float("nan")}, "power_kw nan kW"),
        ({"energy_kwh": -1.0}, "energy_kwh -1.0 kWh must be finite and above 0 kWh"),
        ({"efficiency": 1.2}, r"efficiency 1.2 \(round trip\) is outside \(0, 1\]"),
        ({"efficiency": 0.0}, r"outside \(0, 1\]"),
        ({"cycles_per_day": 0.0}, "cycles_per_day 0.0 must be"),
        ({"look_ahead_h": -24.0}, r"look_ahead_h \(-24 h\) must be a whole number"),
        ({"look_ahead_h": 3.5}, r"look_ahead_h \(3.5 h\) must be a whole number of steps of 1 h"),
        ({"replan_h": 48.0}, "replan_h 48.0 h must not exceed look_ahead_h 24.0 h"),
        ({"dt_h": 0.0}, "control step 0.0 h must be above 0 h"),
    ],
)
def test_bad_parameters_are_refused(changes, match):
    with pytest.raises(InputError, match=match):
        planner(np.ones(24), **changes)


def test_bad_arguments_of_a_plan_are_refused():
    arbitrage = planner(np.ones(24))
    for arguments, match in (
        ((24, 0.0), r"step 24 is outside the series of 24 steps \[0, 23\]"),
        ((-1, 0.0), "step -1"),
        ((0, float("nan")), "stored energy nan kWh at step 0"),
        ((0, 0.0, -1.0), "discharged_today_kwh -1.0 kWh"),
    ):
        with pytest.raises(InputError, match=match):
            arbitrage.plan(*arguments)
    with pytest.raises(InputError, match="3 day numbers do not cover step 23"):
        planner(np.ones(24), days=[0, 0, 0]).plan(0, 0.0)


@pytest.mark.parametrize("foreseen", [[], [1.0, np.nan], np.ones(25), np.ones((2, 2))])
def test_a_forecast_of_the_user_is_checked(foreseen):
    class Mine:
        def ahead(self, step: int, horizon: int) -> np.ndarray:
            return np.asarray(foreseen, dtype=float)

    arbitrage = Arbitrage(
        Mine(), np.zeros(30, dtype=int), power_kw=1.0, energy_kwh=1.0, dt_h=1.0, look_ahead_h=24.0
    )
    with pytest.raises(InputError, match="at step 0 the price forecast must be 1 to 24 finite values"):
        arbitrage.plan(0, 0.0)


def test_the_limits_of_the_grid_connection_hold_in_each_direction():
    price = 50.0 + 40.0 * np.sin(np.arange(24) * 2.0 * np.pi / 12.0)
    plan = planner(price, max_import_kw=30.0, max_export_kw=60.0).plan(0, 0.0)
    assert plan.min() == pytest.approx(-30.0)
    assert 0.0 < plan.max() <= 60.0 + 1e-9
    both = planner(price, max_import_kw=40.0, max_export_kw=40.0).plan(0, 0.0)
    smaller = planner(price, power_kw=40.0).plan(0, 0.0)
    assert revenue(both, price) == pytest.approx(revenue(smaller, price))
    with pytest.raises(InputError, match=r"max_import_kw -1\.0 kW must be finite and above 0 kW"):
        planner(price, max_import_kw=-1.0)


def test_the_smallest_prices_are_traded_as_all_others_are() -> None:
    """Prices below the tolerance of the solver were not traded at all."""
    price = np.random.default_rng(2).normal(60.0, 40.0, 24)
    np.testing.assert_array_equal(planner(2.0**-20 * price).plan(0, 80.0), planner(price).plan(0, 80.0))


@pytest.mark.closed_form
@pytest.mark.parametrize(("fees", "kw"), [((30.0, 49.0), 100.0), ((30.0, 51.0), 0.0)])
def test_a_spread_is_traded_if_it_exceeds_the_fees_of_both_directions(fees, kw) -> None:
    plan = planner(np.array([20.0, 100.0]), efficiency=1.0, fees_eur_mwh=fees).plan(0, 0.0)
    np.testing.assert_allclose(plan, [-kw, kw])


@pytest.mark.closed_form
def test_what_remains_of_a_budget_is_for_the_whole_plan_not_for_each_of_its_days() -> None:
    price = np.tile([20.0, 100.0], 4)
    plan = planner(price, efficiency=1.0, days=np.arange(8) // 4, look_ahead_h=8.0).plan(
        0, 0.0, remaining_kwh=60.0
    )
    assert np.maximum(plan, 0.0).sum() == pytest.approx(60.0)
