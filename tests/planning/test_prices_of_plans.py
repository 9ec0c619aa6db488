"""Claims about the prices that a plan in EUR works with."""

import numpy as np
import pytest

import bess
from bess.control.planning import PlanPrices
from bess.control.planning.prices import MIN_LOSS_PRICE
from bess.system.terms import SettlementTerms

AVAILABILITY, DERATING, INVERTER, BATTERY = range(4)


def prices_of(
    terms: SettlementTerms, price: list[float], demand: list[float], **weights: float
) -> PlanPrices:
    goals = bess.Objectives.money(**weights)
    return PlanPrices.money(goals, terms, np.array(demand), np.array(price), np.zeros(2))


def test_a_loss_costs_as_much_as_later_charging() -> None:
    price = [10.0, 100.0, 30.0, 50.0, 200.0]
    prices = prices_of(SettlementTerms(charge_fee_eur_mwh=5.0), price, [-10.0, 80.0, -10.0, -30.0, 80.0])
    later = (35.0 + 3 * 55.0) / 4
    expected = [(15.0 + 35.0 + 3 * 55.0) / 5, later, later, 55.0, 55.0]  # the last: the median of buying
    for loss in (INVERTER, BATTERY):
        np.testing.assert_allclose(prices.losses[:, loss] * 1000.0, expected)


def test_a_shortfall_costs_what_the_ledger_counts() -> None:
    terms = SettlementTerms(shortfall_eur_mwh=30.0, start_eur=0.5)
    prices = prices_of(terms, [100.0, -40.0], [50.0, -50.0])
    for loss in (AVAILABILITY, DERATING):
        np.testing.assert_allclose(prices.losses[:, loss], [0.130, 0.070])


@pytest.mark.parametrize("start_kwh", [0.0, 0.15, 1.0])
def test_a_start_costs_what_the_ledger_counts_and_its_energy_at_the_price_of_losses(start_kwh: float) -> None:
    goals = bess.Objectives.money(start_kwh=start_kwh)
    price = np.array([100.0, 40.0])
    prices = PlanPrices.money(
        goals, SettlementTerms(start_eur=0.5), np.array([50.0, -50.0]), price, np.zeros(2)
    )
    assert prices.start == pytest.approx(0.5 + start_kwh * 0.040)
    assert bess.Objectives.money().start_kwh == 0.15


def test_no_price_makes_losses_welcome() -> None:
    for price, usual_eur_mwh in (([-100.0, 20.0], 60.0), ([0.0, 0.0], 50.0)):  # the second: of a shortfall
        prices = prices_of(SettlementTerms(), price, [-50.0, 50.0])
        np.testing.assert_allclose(prices.losses[:, INVERTER] * 1000.0, MIN_LOSS_PRICE * usual_eur_mwh)


@pytest.mark.parametrize("currency", [2.0**-10, 2.0**10])
def test_a_plan_does_not_depend_on_the_currency(currency: float) -> None:
    """Some energy is free, as at noon; the minimum price of losses was 0.001 in any currency."""
    euros, others = (
        prices_of(
            SettlementTerms(shortfall_eur_mwh=30.0 * one, charge_fee_eur_mwh=4.0 * one, start_eur=0.1 * one),
            [80.0 * one, -20.0 * one, -10.0 * one, 90.0 * one],
            [50.0, -50.0, -30.0, 50.0],
        )
        for one in (1.0, currency)
    )
    np.testing.assert_array_equal(others.losses, euros.losses * currency)
    assert others.start == euros.start * currency


def test_weights_multiply_the_prices_of_their_losses() -> None:
    plain, weighted = (
        prices_of(SettlementTerms(), [40.0, 60.0], [-50.0, 50.0], **weights)
        for weights in ({}, {"derating": 2.0, "battery": 0.5})
    )
    np.testing.assert_allclose(weighted.losses, plain.losses * [1.0, 2.0, 1.0, 0.5])


@pytest.mark.parametrize(("price", "demand"), [([1.0], [1.0, 2.0]), ([], []), ([np.nan], [1.0])])
def test_bad_prices_are_refused(price: list[float], demand: list[float]) -> None:
    with pytest.raises(bess.InputError, match="pric"):
        prices_of(SettlementTerms(), price, demand)
