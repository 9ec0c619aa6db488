"""Claims about the most that an ideal store earns on a series of prices."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import bess

INTRADAY = Path(__file__).parents[3] / "shared/data/prices/energy-charts_de_intraday15_2021.csv"
ID3 = "Intraday Continuous 15 minutes ID3-Price"
PUBLISHED = [
    *({"cycles": n, "net": e} for n, e in zip(
        (100, 250, 365, 500, 750), (19_275.0, 30_684.8, 35_829.4, 40_176.4, 45_277.8), strict=True)),
    *({"round_trip": r, "net": e} for r, e in zip(
        (0.7, 0.75, 0.8, 0.9, 0.95, 1.0), (27_889.7, 30_382.6, 32_872.1, 37_790.2, 40_235.0, 42_690.1),
        strict=True)),
    *({"power_kw": p, "net": e} for p, e in zip(
        (250.0, 500.0, 750.0, 1000.0, 1250.0, 1500.0, 1750.0, 2000.0),
        (27_930.1, 35_829.4, 40_034.6, 42_902.2, 45_057.7, 46_681.0, 48_083.3, 49_229.8), strict=True)),
]  # fmt: skip
FEW = (35_829.4, 27_889.7, 49_229.8)
"""Of a year of ID3 prices of 2021 [EUR] (leloq, Rolling Intrinsic BESS Intraday Trading), and those that
every test run repeats; the others are among the slow tests."""


@pytest.mark.skipif(not INTRADAY.exists(), reason="real data are not beside the repository (../shared/data)")
@pytest.mark.golden
@pytest.mark.parametrize(
    "case", [each if each["net"] in FEW else pytest.param(each, marks=pytest.mark.slow) for each in PUBLISHED]
)
def test_published_values_of_a_year_of_intraday_prices_are_met(case: dict[str, float]) -> None:
    arguments = {key: value for key, value in case.items() if key != "net"}
    value = bess.store_value(pd.read_csv(INTRADAY)[ID3], **arguments)
    assert value.net_eur == pytest.approx(case["net"], rel=1e-5)


PRICES = np.random.default_rng(7).normal(40.0, 50.0, 480)


def test_income_and_store_are_those_of_the_powers() -> None:
    """Where no price is negative the powers say it all."""
    price = np.abs(PRICES)
    value = bess.store_value(price, 400.0, 100.0, 0.81, cycles=3.0, initial_kwh=50.0)
    assert value.net_eur == pytest.approx(value.power_kw @ price * 0.25e-3)
    charged, discharged = np.maximum(-value.power_kw, 0.0), np.maximum(value.power_kw, 0.0)
    stored = 50.0 + np.cumsum(0.9 * charged - discharged / 0.9) * 0.25
    np.testing.assert_allclose(value.stored_kwh, stored, atol=1e-6)
    assert value.stored_kwh.min() > -1e-6 and value.stored_kwh.max() < 400.0 + 1e-6
    assert np.abs(value.power_kw).max() <= 100.0 + 1e-6
    assert 0.9 * charged.sum() * 0.25 == pytest.approx(3.0 * 400.0)


def test_the_cycle_price_is_what_a_little_more_budget_earns() -> None:
    less, more = (bess.store_value(PRICES, cycles=cycles) for cycles in (3.0, 3.001))
    assert more.net_eur - less.net_eur == pytest.approx(0.001 * less.cycle_price_eur, rel=0.02)
    free = bess.store_value(PRICES, cycles=None)
    assert free.cycle_price_eur == 0.0
    assert free.net_eur > more.net_eur


def test_a_step_discharges_no_more_than_is_in_store_at_its_start() -> None:
    """Burning energy at a negative price is bounded by what was stored before."""
    value = bess.store_value([-100.0], 31.25, 500.0, 0.25, cycles=None)
    assert value.net_eur == pytest.approx(0.1 * 62.5)  # and no more: 125 kWh could be bought, and burnt
    assert value.stored_kwh == pytest.approx([31.25])


def test_the_step_is_that_of_the_times() -> None:
    hourly = pd.Series(PRICES, index=pd.date_range("2024-01-01", periods=480, freq="1h", tz="UTC"))
    assert bess.store_value(hourly, cycles=9.0) == bess.store_value(PRICES, cycles=9.0, dt_h=1.0)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"cycles": 0.0}, "cycles 0.0 must be finite and above 0"),
        ({"power_kw": np.nan}, "power_kw is nan"),
        ({"round_trip": 1.1}, r"round_trip 1.1 is outside \(0, 1\]"),
        ({"initial_kwh": 1001.0}, r"initial_kwh 1001 kWh is outside \[0, 1000\] kWh"),
        ({"prices": [1.0, np.nan]}, "prices at index 1 is nan"),
        ({"fees_eur_mwh": 5.0}, r"fees_eur_mwh has shape \(\); give two numbers"),
        ({"fees_eur_mwh": (1.0, 2.0, 3.0)}, r"fees_eur_mwh has shape \(3,\); give two numbers"),
        ({"prices": []}, "give one value for each step"),
        ({"prices": pd.Series([1.0] * 3, index=pd.to_datetime([0, 24, 72], unit="h"))}, "24 to 48 h apart"),
    ],
)  # fmt: skip
def test_invalid_arguments_of_store_value_are_refused(arguments: dict[str, object], match: str) -> None:
    with pytest.raises(bess.InputError, match=match):
        bess.store_value(**({"prices": PRICES} | arguments))


def test_a_step_in_seconds_is_no_step_in_hours() -> None:
    with pytest.raises(bess.InputError, match="steps of 900 h are longer than 24 h; give dt_h in hours"):
        bess.store_value(PRICES, dt_h=900)


@pytest.mark.parametrize("currency", [2.0**-10, 2.0**-3, 2.0**10])
def test_another_currency_has_the_same_schedule(currency: float) -> None:
    """Equal prices of the quarters of an hour leave a choice, which was another one in each currency."""
    prices = PRICES[:96].round(2).repeat(4)
    euros, others = (bess.store_value(one * prices, cycles=4.0) for one in (1.0, currency))
    np.testing.assert_array_equal(others.power_kw, euros.power_kw)
    assert others.net_eur == currency * euros.net_eur
    assert others.cycle_price_eur == currency * euros.cycle_price_eur


def test_fees_are_paid_for_the_energy_of_each_direction() -> None:
    """A cycle of 800 kWh at 20 and 100 EUR/MWh: 1,000 kWh charged, 640 kWh discharged; higher fees: none."""
    given = {"energy_kwh": 800.0, "power_kw": 1000.0, "round_trip": 0.64, "cycles": None, "dt_h": 1.0}
    value = bess.store_value([20.0, 100.0], fees_eur_mwh=(5.0, 10.0), **given)
    assert value.net_eur == pytest.approx(0.64 * 90.0 - 1.0 * 25.0)
    assert bess.store_value([20.0, 100.0], fees_eur_mwh=(50.0, 40.0), **given).net_eur == 0.0
