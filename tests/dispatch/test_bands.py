"""Claims about prices that are known as bands, and about dispatch that hedges."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.dispatch import (
    BandForecast,
    DispatchInputs,
    DispatchPlan,
    DynamicProgramDispatch,
    ExternalForecast,
    PersistenceForecast,
    PriceBands,
)
from bess.dispatch.forecast import price_ends_of
from bess.system.terms import SettlementTerms

WAVE = 60.0 - 40.0 * np.cos(np.arange(144) * 0.25 * 2 * np.pi / 12.0)
SYSTEM = bess.System.reference(1)
NO_BUYING = SettlementTerms(charge_fee_eur_mwh=500.0)


def hours(*prices: float) -> np.ndarray:
    return np.repeat(np.array(prices, dtype=float), 4)


def plan(
    dispatch: DynamicProgramDispatch, state: bess.State, bands: PriceBands, *, hedged: bool = True
) -> DispatchPlan:
    price = bands.mean_eur_mwh
    day = np.zeros(price.size, dtype=np.int64)
    ambient_c = np.full(price.size, 25.0)
    inputs = DispatchInputs(price, ambient_c, day, is_last=True, bands=bands if hedged else None)
    return dispatch.plan(inputs, state)


def noise(n: int, seed: int = 0) -> np.ndarray:
    return 50.0 + 20.0 * np.sin(np.arange(n) * np.pi / 48.0) + np.random.default_rng(seed).normal(0.0, 9.0, n)


@pytest.mark.closed_form
def test_a_hedge_waits_where_the_mean_sells() -> None:
    """A store to be sold once: 50 now, then 10 or 70 alike, then 40.

    The mean (50, 40, 40) sells now for 50 EUR/MWh; who waits sells at 70 or at 40: 55 in the mean.
    """
    dispatch, state = DynamicProgramDispatch(SYSTEM, 0.25, NO_BUYING), bess.State([0.18], [25.0])
    up, down = hours(50.0, 70.0, 40.0), hours(50.0, 10.0, 40.0)
    bands = PriceBands(np.stack([down, up]), np.full((2, 2), 0.5), np.full(2, 0.5))
    waits, sells = (plan(dispatch, state, bands, hedged=hedged) for hedged in (True, False))
    assert not waits.demand_kw[:4].any()
    assert sells.demand_kw[:4].sum() > 0.95 * sells.demand_kw.sum() > 0.0
    later = [plan(dispatch, state, PriceBands.certain(price[4:])).expected_net_eur for price in (up, down)]
    assert np.mean(later) / sells.expected_net_eur == pytest.approx(55.0 / 50.0, rel=0.03)


def test_a_band_of_no_width_is_the_point_forecast_to_the_bit() -> None:
    dispatch, state = DynamicProgramDispatch(SYSTEM, 0.25, SettlementTerms()), bess.State([0.4], [25.0])
    transition = np.array([[0.7, 0.2, 0.1], [0.3, 0.3, 0.4], [0.1, 0.2, 0.7]])
    narrow = PriceBands(np.tile(WAVE, (3, 1)), transition, np.array([0.1, 0.6, 0.3]))
    hedged, point = (plan(dispatch, state, narrow, hedged=hedged) for hedged in (True, False))
    np.testing.assert_array_equal(hedged.demand_kw, point.demand_kw)
    assert hedged.expected_net_eur == point.expected_net_eur
    foretold = noise(WAVE.size)
    bands = BandForecast(WAVE, forecast=np.tile(foretold, (3, 1)))
    np.testing.assert_array_equal(bands.ahead(20, 60), ExternalForecast(WAVE, foretold).ahead(20, 60))


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(3))
def test_information_is_never_worth_less_than_nothing(seed: int) -> None:
    """All paths of a tree, in the plant: known prices earn more than a hedge, and a hedge than the mean.

    In 4 of 60 other draws the hedge, which is planned anew each hour, earns up to 0.3 % more than the plan of
    known prices, which is made once.
    """
    rng = np.random.default_rng(seed)
    levels = np.sort(rng.uniform(10.0, 120.0, (2, 3)), axis=0)
    transition, start = np.array([[0.7, 0.3], [0.4, 0.6]]), float(rng.uniform(20.0, 90.0))
    dispatch, state = DynamicProgramDispatch(SYSTEM, 0.25, SettlementTerms()), bess.State([0.2], [25.0])

    def earned(state: bess.State, demand_kw: np.ndarray, price: np.ndarray) -> tuple[float, bess.State]:
        plant = bess.Plant(SYSTEM, state)
        delivered_kw = plant.run(demand_kw[:, None]).delivered_kw.sum(axis=1)
        missing_kw = np.abs(demand_kw) - np.abs(delivered_kw)
        return float(delivered_kw @ price - missing_kw @ (price + 50.0)) * 0.25e-3, plant.state

    def expected(state: bess.State, hour: int, now: np.ndarray, price: float, *, hedged: bool) -> float:
        ahead = np.hstack([np.full((2, 4), price), np.repeat(levels[:, hour:], 4, axis=1)])
        asked = plan(dispatch, state, PriceBands(ahead, transition, now), hedged=hedged).demand_kw
        net, after = earned(state, asked[:4], ahead[0, :4])
        if hour == 3:
            return net
        return net + sum(
            share * expected(after, hour + 1, np.eye(2)[k], float(levels[k, hour]), hedged=hedged)
            for k, share in enumerate(now @ transition)
        )

    even = np.array([0.5, 0.5])
    hedge, mean = (expected(state, 0, even, start, hedged=hedged) for hedged in (True, False))
    known = 0.0
    for path in product(range(2), repeat=3):
        share = even @ transition[:, path[0]] * transition[path[0], path[1]] * transition[path[1], path[2]]
        price = hours(start, *levels[path, range(3)])
        asked = plan(dispatch, state, PriceBands.certain(price)).demand_kw
        known += share * earned(state, asked, price)[0]
    assert known > hedge > 0.0
    assert hedge > mean - 0.005 * known


def test_bands_never_look_ahead() -> None:
    values = noise(500)
    changed = values.copy()
    changed[301:] = -1.0
    seen, other = (BandForecast(each).bands(300, 100) for each in (values, changed))
    for part in ("price_eur_mwh", "transition", "initial"):
        np.testing.assert_array_equal(getattr(seen, part), getattr(other, part))
    assert (seen.price_eur_mwh[:, 0] == values[300]).all()


@pytest.mark.parametrize("kind", [PersistenceForecast, BandForecast])
def test_prices_before_a_run_are_known_from_its_start(kind: type[PersistenceForecast | BandForecast]) -> None:
    values = noise(500)
    np.testing.assert_array_equal(kind(values, first=300).ahead(10, 50), kind(values).ahead(310, 50))


def test_measured_bands_are_the_errors_of_persistence() -> None:
    values = noise(96 * 20)
    step = 96 * 15
    bands = BandForecast(values).bands(step, 50)
    errors = values[96 : step + 1] - values[: step - 95]
    expected = (
        PersistenceForecast(values).ahead(step, 50)
        + np.quantile(errors, (0.05, 0.25, 0.5, 0.75, 0.95))[:, None]
    )
    np.testing.assert_allclose(bands.price_eur_mwh[:, 1:], expected[:, 1:])
    inside = (values[step + 1 : step + 50] > bands.price_eur_mwh[0, 1:]) & (
        values[step + 1 : step + 50] < bands.price_eur_mwh[-1, 1:]
    )
    assert inside.mean() > 0.75


@pytest.mark.closed_form
def test_transitions_are_those_that_were_seen() -> None:
    """Prices that alternate between both outer levels: 100 times of each, and one drawn at random."""
    values = np.tile([0.0, 20.0], 101)[:201]
    bands = BandForecast(values, forecast=np.tile([[0.0], [10.0], [20.0]], 201)).bands(200, 1)
    np.testing.assert_allclose(bands.transition[0], np.array([0.3, 0.4, 100.3]) / 101.0)
    np.testing.assert_allclose(bands.transition[1], [0.3, 0.4, 0.3])
    assert bands.initial.tolist() == [1.0, 0.0, 0.0]


def test_a_price_is_known_to_its_end() -> None:
    hourly = np.repeat([3.0, 4.0, 5.0, 6.0], 4)[2:]
    assert price_ends_of(hourly, 0.25)[:8].tolist() == [2, 2, 6, 6, 6, 6, 10, 10]
    assert price_ends_of(np.arange(4.0), 0.25).tolist() == [1, 2, 3, 4]
    foretold = np.full(14, 9.0)
    ends = price_ends_of(hourly, 0.25)
    assert ExternalForecast(hourly, foretold, price_ends=ends).ahead(3, 4).tolist() == [4.0, 4.0, 4.0, 9.0]


@pytest.mark.closed_form
@pytest.mark.parametrize("shift", [0, 1, 3])
def test_hourly_prices_before_prices_of_quarter_hours_are_known_to_their_end(shift: int) -> None:
    """As in Germany from October 2025 on; the day of the change counts as one of quarter hours."""
    values = np.r_[np.repeat(noise(72), 4), noise(48, 1), np.repeat(noise(72, 2), 4)][shift:]
    steps, ends = np.arange(values.size), price_ends_of(values, 0.25)
    hours = steps + 4 - (steps + shift) % 4
    np.testing.assert_array_equal(ends[: 2 * 96], hours[: 2 * 96])
    np.testing.assert_array_equal(ends[3 * 96 : 4 * 96 - 4], steps[3 * 96 : 4 * 96 - 4] + 1)
    np.testing.assert_array_equal(ends[4 * 96 :], hours[4 * 96 :])


@pytest.mark.parametrize(
    ("foretold", "match"),
    [
        (np.ones((3, 4)), r"bands of shape \(3, 4\) do not fit a series of 5 steps"),
        (np.array([[1.0] * 5, [2.0] * 5, [3.0, 3.0, 1.0, 3.0, 3.0]]), "at step 2 .* ascend"),
        (np.full((3, 5), np.nan), "at step 0 .* must be finite"),
    ],
)
def test_invalid_bands_are_refused(foretold: np.ndarray, match: str) -> None:
    with pytest.raises(bess.InputError, match=match):
        BandForecast(np.ones(5), forecast=foretold)


def test_a_run_reads_bands_from_a_file(tmp_path: Path) -> None:
    """Of no width, they give the run of their mean; of some width, another."""
    times = pd.date_range("2024-06-01", periods=20, freq="1h", tz="UTC").strftime("%Y-%m-%dT%H:%M:%SZ")
    price, middle = 60.0 - 40.0 * np.cos(np.arange(20) * np.pi / 5.0), noise(20, 3)

    def run(width: float, **keys: Any) -> bess.Result:
        table = {"p10": middle - width, "p50": middle, "p90": middle + width}
        foretold = tmp_path / "foretold.csv"
        pd.DataFrame({"time": times} | table).to_csv(foretold, index=False)
        pd.DataFrame({"time": times, "DE-LU": price}).to_csv(tmp_path / "prices.csv", index=False)
        values = {
            "demand.prices": str(tmp_path / "prices.csv"),
            "demand.forecast_prices": str(foretold),
            "policy.name": "equal",
            "demand.look_ahead_h": 10.0,
            "run.days": 0.25,
        }
        return bess.run(bess.load_study("arbitrage-2024", values | keys), progress=False)

    narrow, wide = (run(width, **{"demand.forecast": "bands"}) for width in (0.0, 40.0))
    expected = run(0.0, **{"demand.forecast": "expected"})
    np.testing.assert_array_equal(narrow.dataset["demand_kw"], expected.dataset["demand_kw"])
    assert np.abs(narrow.dataset["demand_kw"] - wide.dataset["demand_kw"]).max() > 10.0
    with pytest.raises(bess.InputError, match="forecast_prices needs forecast"):
        run(0.0, **{"demand.forecast": "persistence"})
    with pytest.raises(bess.InputError, match=r"demand.forecast_prices .*foretold.csv: bands: .* ascend"):
        run(-1.0, **{"demand.forecast": "bands"})
