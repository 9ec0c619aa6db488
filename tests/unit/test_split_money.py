"""Claims about the prices that a split in EUR works with."""

import numpy as np
import pytest

import bess
from bess.parameters.terms import Terms
from bess.split.money import split_prices


def test_a_loss_costs_what_the_charging_to_come_costs() -> None:
    price = [10.0, 100.0, 30.0, 50.0, 200.0]
    prices = split_prices(Terms(charge_fee_eur_mwh=5.0), price, [-10.0, 80.0, -10.0, -30.0, 80.0])
    later = (35.0 + 3 * 55.0) / 4
    expected = [(15.0 + 35.0 + 3 * 55.0) / 5, later, later, 55.0, 55.0]  # the last: the median of buying
    np.testing.assert_allclose(prices.loss_eur_kwh * 1000.0, expected)


def test_a_shortfall_costs_what_the_ledger_counts() -> None:
    terms = Terms(shortfall_eur_mwh=30.0, start_eur=0.5)
    prices = split_prices(terms, [100.0, -40.0], [50.0, -50.0])
    np.testing.assert_allclose(prices.shortfall_eur_kwh, [0.130, 0.070])
    assert prices.start_eur == 0.5


def test_no_price_makes_losses_welcome() -> None:
    prices = split_prices(Terms(), [-100.0, 20.0], [-50.0, 50.0])
    assert (prices.loss_eur_kwh >= 0.0).all()


@pytest.mark.parametrize(("price", "demand"), [([1.0], [1.0, 2.0]), ([], []), ([np.nan], [1.0])])
def test_bad_prices_are_refused(price: list[float], demand: list[float]) -> None:
    with pytest.raises(bess.InputError, match="pric"):
        split_prices(Terms(), price, demand)
