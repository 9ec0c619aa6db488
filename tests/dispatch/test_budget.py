"""Claims about a budget of a year and the price that spends it."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.dispatch import Arbitrage, CycleBudget, PerfectForecast

DATA = Path(__file__).parents[3] / "shared/data/prices"
ENERGY_KWH, POWER_KW, ROUND_TRIP = 1000.0, 500.0, 0.86


def budget(price: np.ndarray, cycles: float, throughput_kwh: float = np.inf, **more: Any) -> CycleBudget:
    return CycleBudget(
        PerfectForecast(price),
        np.array([0, price.size]),
        price.size,
        cycles=cycles,
        throughput_kwh=throughput_kwh,
        nominal_kwh=np.array([ENERGY_KWH]),
        usable_kwh=ENERGY_KWH,
        power_kw=POWER_KW,
        efficiency=ROUND_TRIP,
        look_ahead_steps=144,
        dt_h=0.25,
        **more,
    )


def at(soc: float) -> bess.State:
    return bess.State([soc], [25.0])


def traded(price: np.ndarray, carried: CycleBudget) -> tuple[float, float]:
    """Income [EUR] and cycles of an ideal store that trades with 36 h of foresight."""
    arbitrage = Arbitrage(
        PerfectForecast(price), np.zeros(price.size), power_kw=POWER_KW, energy_kwh=ENERGY_KWH,
        efficiency=ROUND_TRIP, cycles_per_day=1e6, replan_h=6.0,
    )  # fmt: skip
    one_way, stored_kwh, before_kw, earned = np.sqrt(ROUND_TRIP), 0.0, 0.0, 0.0
    discharged_kwh = 0.0
    for step in range(price.size):
        carried.advance(step, at(stored_kwh / ENERGY_KWH), before_kw)
        if arbitrage.is_due(step):
            plan_kw = arbitrage.plan(
                step,
                stored_kwh,
                budget_price_eur_mwh=carried.price_eur_mwh,
                remaining_kwh=carried.remaining_kwh,
            )
        before_kw = float(carried.limited(plan_kw[step % 24 : step % 24 + 1])[0])
        drawn_kwh = 0.25 * (before_kw / one_way if before_kw > 0.0 else before_kw * one_way)
        discharged_kwh += max(0.0, drawn_kwh)
        stored_kwh -= drawn_kwh
        earned += 0.25e-3 * before_kw * price[step]
    return earned, discharged_kwh / ENERGY_KWH


def _year(name: str) -> np.ndarray:
    if name == "2021":
        file = DATA / "energy-charts_de_intraday15_2021.csv"
        column = "Intraday Continuous 15 minutes ID3-Price"
        return pd.read_csv(file)[column].to_numpy(float)
    return bess.read_prices(DATA / "smard_de_viertelstunde_2024_berechnet_resaved.csv").to_numpy()


@pytest.mark.skipif(not DATA.exists(), reason="real data are not beside the repository (../shared/data)")
@pytest.mark.slow
@pytest.mark.golden
@pytest.mark.parametrize("cycles", [250.0, 365.0])
@pytest.mark.parametrize("name", ["2021", "2024"])
def test_a_year_with_36_hours_of_foresight_earns_95_percent_of_a_known_year(name: str, cycles: float) -> None:
    price = _year(name)
    earned, used = traded(price, budget(price, cycles))
    assert used <= cycles
    assert earned >= 0.95 * bess.store_value(price, cycles=cycles).net_eur


HOURS = np.arange(0.0, 24.0 * 28, 0.25)
DAILY = 60.0 + 40.0 * np.sin(2.0 * np.pi * HOURS / 24.0) + 15.0 * np.sin(2.0 * np.pi * HOURS / 6.0)


@pytest.mark.parametrize("limit", ["cycles", "throughput"])
def test_a_budget_is_spent_and_never_exceeded(limit: str) -> None:
    cycles, throughput_kwh = (14.0, np.inf) if limit == "cycles" else (np.inf, 14.0e3)
    earned, used = traded(DAILY, budget(DAILY, cycles, throughput_kwh))
    free, most = traded(DAILY, budget(DAILY, 1e6))
    allowed = 14.0 if limit == "cycles" else 14.0 / np.sqrt(ROUND_TRIP)
    assert 0.95 * allowed < used <= allowed < most
    assert earned > 0.95 * bess.store_value(DAILY, cycles=allowed).net_eur
    assert earned < free


def test_a_budget_that_does_not_bind_has_no_price() -> None:
    carried = budget(DAILY, 1e6)
    carried.advance(0, at(0.5), 0.0)
    assert carried.price_eur_mwh == 0.0


def test_the_price_of_the_first_day_is_what_a_cycle_earns_on_it() -> None:
    carried = budget(DAILY, 14.0)
    carried.advance(0, at(0.5), 0.0)
    due = 14.0 / 28.0 * 0.85 / np.expm1(0.85) * 1.5
    value = bess.store_value(DAILY[:144], cycles=due)
    assert carried.price_eur_mwh == pytest.approx(value.cycle_price_eur / np.sqrt(ROUND_TRIP))


@pytest.mark.closed_form
def test_fees_and_wear_lower_the_price_by_what_they_cost_down_to_zero() -> None:
    """A store that begins empty and empties discharges the round trip of what it charges."""
    costs = [((0.0, 0.0), 0.0), ((4.0, 5.0), 7.0), ((40.0, 50.0), 70.0)]
    prices = []
    for fees_eur_mwh, wear_eur_mwh in costs:
        carried = budget(
            DAILY, 14.0, fees_eur_mwh=fees_eur_mwh, wear_eur_mwh=lambda *_, wear=wear_eur_mwh: wear
        )
        carried.advance(0, at(0.5), 0.0)
        prices.append(carried.price_eur_mwh)
    assert prices[1] == pytest.approx(prices[0] - 4.0 / ROUND_TRIP - 5.0 - 7.0)
    assert prices[2] == 0.0


def test_a_budget_that_the_daily_limit_keeps_has_no_price() -> None:
    """Over 28 days with one cycle a day at most."""
    prices = []
    for cycles in (27.0, 28.0):
        carried = budget(DAILY, cycles, daily_kwh=ENERGY_KWH)
        carried.advance(0, at(0.0), 0.0)
        prices.append(carried.price_eur_mwh)
    assert prices[0] > 0.0 == prices[1]


def test_the_price_rises_where_more_was_used_than_was_due() -> None:
    prices = []
    for soc in ([1.0, 1.0], [1.0, 0.0]):
        carried = budget(DAILY, 14.0)
        for step, each in zip((0, 96), soc, strict=True):
            carried.advance(step, at(each), 0.0)
        prices.append(carried.price_eur_mwh)
    assert prices[1] > 1.02 * prices[0]


def test_each_year_has_its_own_budget_and_the_last_a_part_of_one() -> None:
    carried = CycleBudget(
        PerfectForecast(DAILY), np.array([0, 960, 1920, 2880]), DAILY.size, cycles=10.0,
        throughput_kwh=np.inf, nominal_kwh=np.array([ENERGY_KWH]), usable_kwh=ENERGY_KWH, power_kw=POWER_KW,
        efficiency=ROUND_TRIP, look_ahead_steps=144, dt_h=0.25,
    )  # fmt: skip
    left = []
    for step in (0, 959, 960, 1920):
        carried.advance(step, at(0.5 if step == 959 else 1.0), 0.0)
        left.append(carried.remaining_kwh)
    assert left == pytest.approx([10e3, 9.5e3, 10e3, 8e3])


def test_a_cycle_is_the_nominal_energy_through_the_cells_of_strings_of_any_size_and_age() -> None:
    """Of 1,000 and 250 kWh when new, 700 and 225 are left; the first is discharged by half."""
    carried = CycleBudget(
        PerfectForecast(DAILY), np.array([0, DAILY.size]), DAILY.size, cycles=10.0, throughput_kwh=np.inf,
        nominal_kwh=np.array([1000.0, 250.0]), usable_kwh=925.0, power_kw=POWER_KW,
        efficiency=ROUND_TRIP, look_ahead_steps=144, dt_h=0.25,
    )  # fmt: skip
    for step, soc in enumerate(([0.9, 0.3], [0.4, 0.5])):
        carried.advance(step, bess.State(soc, [25.0, 25.0], [0.7, 0.9]), 0.0)
    assert carried.cycles_used == pytest.approx(0.5 * 700.0 / 1250.0)
    assert carried.recorded()["budget_cycles"] == carried.cycles_used


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cycles": 0.0}, "budget: cycles 0 must be above 0"),
        ({"cycles": np.nan}, "budget: cycles nan must be above 0"),
        ({"cycles": "10"}, "budget: cycles must be an array of numbers"),
        ({"throughput_kwh": np.nan}, "budget: throughput_kwh nan must be above 0"),
        ({"daily_kwh": -1.0}, "budget: daily_kwh -1 must be above 0"),
    ],
)
def test_a_budget_that_is_none_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(bess.InputError, match=message):
        budget(DAILY, **{"cycles": 14.0} | values)


@pytest.mark.parametrize("nominal_kwh", [[np.nan], [-5.0], [], 1000.0, ["a"]])
def test_a_store_that_is_none_has_no_budget(nominal_kwh: Any) -> None:
    with pytest.raises(bess.InputError, match="budget: nominal_kwh"):
        CycleBudget(
            PerfectForecast(DAILY), np.array([0, DAILY.size]), DAILY.size, cycles=10.0, throughput_kwh=np.inf,
            nominal_kwh=nominal_kwh, usable_kwh=925.0, power_kw=POWER_KW, efficiency=ROUND_TRIP,
            look_ahead_steps=144, dt_h=0.25,
        )  # fmt: skip
