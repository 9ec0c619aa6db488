"""Claims about the blocks of a dispatch program: steps of one price planned as one."""

import numpy as np
import pytest

import bess
from bess.dispatch import Arbitrage, DispatchInputs, DynamicProgramDispatch, PerfectForecast
from bess.dispatch.blocks import Blocks
from bess.system.terms import SettlementTerms


def test_blocks_end_where_price_or_day_changes_and_after_an_hour() -> None:
    price = np.repeat([1.0, 2.0, 2.0, 2.0, 3.0], [3, 4, 4, 1, 2])
    day = np.r_[np.zeros(5, dtype=np.int64), np.ones(9, dtype=np.int64)]
    blocks = Blocks.of(price, day, 0.25)
    assert blocks.count.tolist() == [3, 2, 4, 3, 2]
    assert blocks.first.tolist() == [0, 3, 5, 9, 12]
    assert blocks.mean(np.arange(14.0)).tolist() == [1.0, 3.5, 6.5, 10.0, 12.5]


def test_prices_of_every_step_and_long_steps_are_blocks_of_one() -> None:
    assert (Blocks.of(np.arange(6.0), np.zeros(6, dtype=np.int64), 0.25).count == 1).all()
    assert (Blocks.of(np.ones(6), np.zeros(6, dtype=np.int64), 2.0).count == 1).all()


def test_the_first_hours_are_cut_finer() -> None:
    blocks = Blocks.of(np.ones(48), np.zeros(48, dtype=np.int64), 0.25, first_h=2.0, step_h=0.5)
    assert blocks.count.tolist() == [2] * 4 + [4] * 10


@pytest.mark.parametrize(("soc", "temperature_c"), [(0.5, 25.0), (0.1, 44.0)])
def test_a_plan_in_blocks_earns_as_much_as_one_in_steps(soc: float, temperature_c: float) -> None:
    """A thousandth of a cent per MWh tells the steps apart, so that each is a block of its own."""
    system = bess.System.reference(2)
    state = bess.State([soc] * 2, [temperature_c] * 2)
    price = np.repeat(60.0 - 40.0 * np.cos(np.arange(36) * 2 * np.pi / 12.0), 4)
    told_apart = price + 1e-5 * np.tile([0.0, 1.0], 72)
    dispatch = DynamicProgramDispatch(system, 0.25, SettlementTerms())
    blocks, steps = (
        dispatch.plan(DispatchInputs(each, np.full(144, 25.0), np.arange(144) // 96, is_last=True), state)
        for each in (price, told_apart)
    )
    assert blocks.expected_net_eur > 0.995 * steps.expected_net_eur
    assert np.abs(steps.demand_kw).sum() * 0.25 > 1000.0


def test_a_linear_program_over_blocks_is_the_one_over_their_steps() -> None:
    """Prices of the steps that differ by a millionth make every step a block, and hardly move the optimum."""
    steps, quarter = 96, np.random.default_rng(3).normal(60.0, 40.0, 24)
    price = np.repeat(quarter, 4)
    uneven = price + 1e-5 * np.arange(steps)
    day = np.zeros(steps, dtype=np.int64)

    def income(prices: np.ndarray) -> float:
        plan = Arbitrage(
            PerfectForecast(prices), day, power_kw=100.0, energy_kwh=170.0, efficiency=0.9, look_ahead_h=24.0
        ).plan(0, 30.0)
        return float(plan @ price)

    here, there = income(price), income(uneven)
    assert here == pytest.approx(there, rel=1e-6)
    # At full power, at the end of a block, as a vertex of the program over steps.
    np.testing.assert_allclose(
        Blocks.of(price, day, 0.25).at_full(np.r_[-0.6, np.zeros(23)])[:4],
        [0.0, -0.4, -1.0, -1.0],
        atol=1e-12,
    )
