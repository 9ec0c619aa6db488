"""Claims about plants that sell in auctions before they trade in the last market."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.dispatch import Arbitrage, PerfectForecast, auction_positions, reserve_blocks
from bess.dispatch.arbitrage import calendar_days
from bess.dispatch.markets import AuctionForecast, four_hour_blocks
from bess.errors import InputError
from bess.simulation.inputs import prepare

RNG = np.random.default_rng(5)
DAY = 96
FIRST, SECOND, LAST = (RNG.normal(60.0, 40.0, 3 * DAY) for _ in range(3))


def positions(*prices: Any, product_steps: Any = (1, 1), foresight: bool = True) -> Any:
    """Positions of a store of 100 kW and 200 kWh over the days of the prices."""
    n = prices[0].size
    planner = Arbitrage(
        PerfectForecast(prices[0]), np.arange(n) // DAY, power_kw=100.0, energy_kwh=200.0, efficiency=0.81,
        look_ahead_h=24.0, replan_h=0.25,
    )  # fmt: skip
    return auction_positions(
        prices, planner, product_steps=product_steps[: len(prices) - 1], stored_kwh=0.0, foresight=foresight
    )


def alone(price: Any) -> Any:
    """Schedule that earns most in one market."""
    return positions(price, 0.0 * price)[:, 0]


def stored_kwh(schedule: Any) -> Any:
    return np.cumsum(np.where(schedule > 0.0, -schedule / 0.9, -schedule * 0.9)) * 0.25


def test_together_earns_no_less_than_the_best_market_alone() -> None:
    prices = [each[:DAY] for each in (FIRST, SECOND, LAST)]
    best = max(float(alone(each) @ each) for each in prices)
    sold = positions(*prices)
    together = alone(prices[2]) @ prices[2] + (sold * (np.stack(prices[:2], 1) - prices[2][:, None])).sum()
    assert together > 1.2 * best


def test_nothing_is_gained_from_a_second_market_of_the_same_prices() -> None:
    sold = positions(LAST, LAST)
    assert float(sold[:, 0] @ (LAST - LAST)) == 0.0
    np.testing.assert_allclose(positions(FIRST, FIRST, LAST).sum(axis=1), positions(FIRST, LAST)[:, 0])


def test_every_schedule_after_a_gate_can_be_delivered() -> None:
    schedules = np.cumsum(positions(FIRST, SECOND, LAST, product_steps=(4, 1)), axis=1)
    for schedule in schedules.T:
        assert np.abs(schedule).max() <= 100.0 + 1e-6 and np.abs(schedule).max() > 50.0
        assert stored_kwh(schedule).min() > -1e-3 and stored_kwh(schedule).max() < 200.0 + 1e-3
    hourly = schedules[:, 0].reshape(-1, 4)
    np.testing.assert_allclose(hourly, np.repeat(hourly[:, :1], 4, axis=1), atol=1e-9)


def test_without_foresight_a_day_is_sold_by_the_prices_of_the_day_before() -> None:
    sold = positions(FIRST, LAST, foresight=False)[:, 0]
    assert not sold[:DAY].any()
    np.testing.assert_allclose(sold[DAY : 2 * DAY], alone(FIRST[:DAY]), atol=1e-6)


def test_an_auction_is_the_forecast_of_what_follows_it_from_the_afternoon_before() -> None:
    forecast = AuctionForecast(LAST, FIRST, np.arange(3 * DAY) // DAY, 0.25)
    morning, evening = forecast.ahead(8 * 4, 2 * DAY), forecast.ahead(15 * 4, DAY)
    assert morning[0] == LAST[8 * 4] and evening[0] == LAST[15 * 4]
    np.testing.assert_array_equal(morning[1 : 16 * 4], FIRST[8 * 4 + 1 : DAY])
    np.testing.assert_array_equal(morning[16 * 4 : 16 * 4 + DAY], FIRST[:DAY])
    np.testing.assert_array_equal(evening[1:], FIRST[15 * 4 + 1 : 15 * 4 + DAY])


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("prices")
    times = pd.date_range("2024-01-31 23:00", periods=3 * DAY, freq="15min", tz="UTC")
    for name, price in (("auction", FIRST), ("last", LAST)):
        pd.Series(price, times, name="price_eur_mwh").rename_axis("time").to_csv(folder / f"{name}.csv")
    return {
        "demand.prices": str(folder / "last.csv"),
        "demand.plan": "linear",
        "demand.market": [{"name": "day-ahead", "prices": str(folder / "auction.csv")}],
        "policy.name": "equal",
        "wear.model": "none",
        "run.start": "2024-01-31T23:00:00Z",
        "run.days": 2.0,
    }


def test_positions_are_settled_to_the_cent_and_sum_to_what_is_delivered(values: dict[str, Any]) -> None:
    result = bess.run(bess.load_study("arbitrage-2024", values), progress=False)
    record, entries = result.dataset, bess.ledger(result)
    sold = record["position_kw"].values
    np.testing.assert_array_equal(
        record["auction_price_eur_mwh"].values[:, 0].reshape(-1, 4)[:, 0], FIRST[: 2 * DAY : 4]
    )
    delivered = record["delivered_kw"].values.sum(axis=1)
    last = delivered - sold.sum(axis=1)
    income = (sold[:, 0] @ FIRST[: 2 * DAY] + last @ LAST[: 2 * DAY]) * 0.25 / 1000.0
    costs = sum(
        float(entries[name].sum()) for name in ("shortfall_eur", "wear_eur", "start_eur", "auxiliary_eur")
    )
    assert result.kpis["position_revenue_eur"] > 1.0
    assert result.kpis["net_eur"] == pytest.approx(income - costs, abs=0.005)


def test_aged_strings_sell_no_more_than_they_hold(values: dict[str, Any]) -> None:
    aged = values | {"system.initial_soh_capacity": 0.6, "system.initial_soc": 0.0}
    inputs = prepare(bess.load_study("arbitrage-2024", aged))
    kw = inputs.series["position_kw"][:, 0]
    stored_kwh = -np.cumsum(np.where(kw < 0.0, kw * 0.9**0.5, kw / 0.9**0.5)) * 0.25
    held_kwh = 0.6 * float(inputs.system.nominal_energy_kwh.sum())
    assert 0.9 * held_kwh < np.ptp(stored_kwh) < held_kwh + 1.0


def test_an_auction_without_a_product_reads_the_default_of_its_file(
    values: dict[str, Any], tmp_path: Path
) -> None:
    """The product of the last market is that of its own file only."""
    times = pd.date_range("2024-02-01", periods=3 * DAY, freq="15min", tz="Europe/Berlin")
    units = ["", "Price (EUR/MWh)", "Price (EUR/MWh)"]
    rows = [
        [time.isoformat(), f"{first:.2f}", f"{last:.2f}"]
        for time, first, last in zip(times, FIRST, LAST, strict=True)
    ]
    table = pd.DataFrame(
        [units, *rows], columns=["Date", "Day Ahead Auction", "Intraday Continuous 15 minutes ID1-Price"]
    )
    table.to_csv(tmp_path / "both.csv", index=False)
    both = values | {
        "demand.prices": str(tmp_path / "both.csv"),
        "demand.product": "id1",
        "demand.market": [{"name": "day-ahead"}],
    }
    record = prepare(bess.load_study("arbitrage-2024", both))
    np.testing.assert_allclose(record.price_eur_mwh, LAST[: 2 * DAY], atol=0.006)
    np.testing.assert_allclose(record.series["auction_price_eur_mwh"][:, 0], FIRST[: 2 * DAY], atol=0.006)


@pytest.mark.parametrize("other", ["market", "forecast"])
def test_all_prices_repeat_if_those_of_the_last_market_do(values: dict[str, Any], other: str) -> None:
    """The run lasts a day longer than the files, which have three days."""
    more = {"run.days": 4.0, "demand.repeat": True}
    if other == "forecast":
        more |= {"demand.market": [], "demand.forecast": "file"}
        more["demand.forecast_prices"] = values["demand.market"][0]["prices"]
    inputs = prepare(bess.load_study("arbitrage-2024", values | more))
    np.testing.assert_allclose(inputs.price_eur_mwh, np.r_[LAST, LAST[:DAY]])
    if other == "market":
        np.testing.assert_allclose(inputs.series["auction_price_eur_mwh"][:, 0], np.r_[FIRST, FIRST[:DAY]])


def test_auctions_that_cannot_be_settled_are_refused(values: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="positions of several markets are not settled behind a meter"):
        bess.load_study("arbitrage-2024", values | {"demand.meter.pv": "solar-week"})
    longer = [{"name": "a", "step_min": 15.0}, {"name": "b", "step_min": 60.0}]
    with pytest.raises(InputError, match="must not have longer products than an earlier one"):
        bess.load_study("arbitrage-2024", values | {"demand.market": longer})


@pytest.mark.closed_form
def test_reserve_is_sold_where_it_earns_more_than_the_trade_beside_it() -> None:
    """A kW in the dear block earns 4 h x 100 EUR/MWh, less 4 h x 20 to charge it before."""
    energy = np.repeat([20.0, 20.0, 20.0, 100.0, 20.0, 20.0], 4)
    planner = Arbitrage(
        PerfectForecast(energy), np.zeros(24, int), power_kw=100.0, energy_kwh=1200.0, efficiency=1.0,
        look_ahead_h=24.0, replan_h=1.0, dt_h=1.0,
    )  # fmt: skip
    for price, sold in ((79.0, 0.0), (81.0, 60.0)):
        paid = np.repeat([0.0, 0.0, 0.0, price, 1.0, 0.0], 4)
        reserve = reserve_blocks(
            paid,
            energy,
            planner,
            blocks=np.arange(24) // 4,
            max_reserve_kw=60.0,
            stored_kwh=0.0,
            foresight=True,
        )
        np.testing.assert_allclose(reserve[12:16], sold, atol=1e-6)
        np.testing.assert_allclose(reserve[16:20], 60.0)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ("2024-03-30 09:00", "2024-04-01 21:00"),
        ("2024-03-30 09:00", "2024-03-31 22:00"),  # to the end of a day of 23 h
        ("2024-10-26 00:00", "2024-10-27 23:00"),  # of 25 h
        ("2024-10-26 00:00", "2024-10-27 22:00"),  # after 24 h of 25
    ],
)
def test_blocks_of_reserve_are_those_of_the_local_day(start: str, end: str) -> None:
    times = pd.date_range(start, end, freq="15min", tz="UTC", inclusive="left")
    local, day = times.tz_convert("Europe/Berlin"), calendar_days(times, "Europe/Berlin")
    block = (day - day[0]) * 6 + local.hour.to_numpy() // 4
    random = np.random.default_rng(3)
    paid, energy = random.uniform(0.0, 40.0, block[-1] + 1)[block], random.normal(60.0, 50.0, times.size)
    planner = Arbitrage(PerfectForecast(energy), day, power_kw=100.0, energy_kwh=150.0, replan_h=0.25)
    sold = reserve_blocks(
        paid,
        energy,
        planner,
        blocks=four_hour_blocks(times, "Europe/Berlin"),
        max_reserve_kw=60.0,
        stored_kwh=50.0,
        foresight=True,
    )
    by_block = pd.Series(sold).groupby(block)
    assert (by_block.max() - by_block.min()).max() < 1e-6 < by_block.mean().std()


@pytest.mark.closed_form
def test_reserve_leaves_the_power_for_charge_and_discharge_one_after_the_other() -> None:
    """Four hours at -100 EUR/MWh pay for a charge, a discharge and a charge; reserve is worth less.

    Of the sixteen steps, twelve charge and four discharge.
    """
    price, paid = np.repeat([-100.0, 0.0], [16, 80]), np.repeat([1.0, 0.0], [16, 80])
    planner = Arbitrage(
        PerfectForecast(price), np.zeros(DAY), power_kw=100.0, energy_kwh=50.0, efficiency=0.5,
        cycles_per_day=1.0, look_ahead_h=24.0,
    )  # fmt: skip
    sold = reserve_blocks(
        paid,
        price,
        planner,
        blocks=np.arange(DAY) // 16,
        max_reserve_kw=100.0,
        stored_kwh=0.0,
        foresight=True,
    )
    both_kw = 2.0 * 50.0 / np.sqrt(0.5) / 4.0
    assert sold[0] == pytest.approx(100.0 - both_kw * 16.0 / 12.0, abs=1.0)
    assert sold[0] < 100.0 - both_kw


def test_chosen_reserve_is_what_the_plant_sells_and_is_paid_for() -> None:
    values = {"policy.name": "equal", "run.days": 2.0, "demand.choose_capacity": "persistence"}
    result = bess.run(bess.load_study("fcr-arbitrage", values), progress=False)
    record = result.dataset
    sold = record["capacity_kw"].values
    assert not sold[: DAY - 4].any() and sold.max() > 0.0
    assert not record["response_kw"].values[sold == 0.0].any()
    paid = float(sold @ record["capacity_price_eur_mw_h"].values) * 0.25 / 1000.0
    assert result.kpis["capacity_revenue_eur"] == pytest.approx(paid)
    assert np.abs(record["demand_kw"].values).max() <= record.attrs.get("nominal_kw", 360.0) + 1e-6


def test_the_energy_kept_for_a_reserve_does_not_depend_on_later_sales(tmp_path: Path) -> None:
    """Reserve has no price on two days, and one on the next two: reserve is first sold on the fourth."""
    times = pd.date_range("2024-01-01", periods=24, freq="4h", tz="UTC")

    def run(later_eur_mw: float) -> Any:
        price = pd.Series(np.repeat([0.0, later_eur_mw], 12), times, name="price").rename_axis("time")
        price.to_csv(tmp_path / "capacity.csv")
        values = {
            "policy.name": "equal",
            "run.start": "2024-01-01T00:00:00Z",
            "run.days": 4.0,
            "demand.choose_capacity": "persistence",
            "demand.capacity_prices": str(tmp_path / "capacity.csv"),
            "demand.replan_h": 6.0,
        }
        return bess.run(bess.load_study("fcr-arbitrage", values), progress=False).dataset

    without, later = run(0.0), run(800.0)
    assert later["capacity_kw"].values.max() > 0.0 == without["capacity_kw"].values.max()
    for name in ("schedule_kw", "demand_kw", "soc"):
        np.testing.assert_array_equal(without[name].values[:DAY], later[name].values[:DAY])
