"""Markets before the last one of a plant: auctions, and four-hour blocks of reserve."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import tzinfo
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array
from bess.dispatch.arbitrage import Arbitrage, calendar_days, one_direction

if TYPE_CHECKING:
    import pandas as pd

_LEAD_TIME_H: Final = 9.0
"""Lead time of the auction of a day [h]: it is cleared at 15:00 of the day before."""

_MIN_POSITION: Final = 1e-9
"""Share of the plant's power below which a position is zero."""


def auction_positions(
    prices: Sequence[Array],
    planner: Arbitrage,
    *,
    product_steps: Sequence[int],
    stored_kwh: float,
    foresight: bool,
) -> Array:
    r"""Return the position in each auction before the last market, day by day.

    With prices :math:`\pi_k` of the markets in the order of their gates and the schedule :math:`s_k` of the
    plant after gate :math:`k`, the position is :math:`s_k - s_{k-1}`, and the income of all is

    .. math:: \sum_{k \le K} \pi_k (s_k - s_{k-1})
       = \sum_{k<K} s_k (\pi_k - \pi_{k+1}) + s_K \pi_K .

    The program over all markets therefore separates into one store program for each. With foresight, the
    schedule of an auction maximises the income at its price less that of the next market. Without foresight,
    the next price is expected to equal the auction price, and the schedule maximises the income at the prices
    of the day before (rolling intrinsic). Every schedule is feasible for the store, from the final stored
    energy of the day before. The last market determines the dispatch of the plant, :math:`s_K`.

    Parameters
    ----------
    prices : sequence of ndarray, shape (n_steps,)
        Prices of the auctions, then of the last market [EUR/MWh].
    planner : Arbitrage
        Store, days, look-ahead and control step; its prices are not used.
    product_steps : sequence of int
        Control steps of a product of each auction.
    stored_kwh : float
        Energy at the start.
    foresight : bool
        Whether prices are known. Otherwise, prices of the day before are used, and day one has no position.

    Returns
    -------
    ndarray, shape (n_steps, n_auctions)
        Positions [kW], positive = sold.
    """
    schedules = [np.zeros(planner.days.size)]
    for own, following, steps in zip(prices, prices[1:], product_steps, strict=False):
        value = own - following if foresight else own
        schedules.append(_schedule(value, planner, steps, stored_kwh, foresight=foresight))
    return np.diff(np.stack(schedules, axis=1), axis=1)


def _schedule(
    value: Array,
    planner: Arbitrage,
    product_steps: int,
    stored_kwh: float,
    *,
    foresight: bool,
) -> Array:
    """Return the schedule of maximum income at ``value``, in products of ``product_steps``."""
    schedule, one_way = np.zeros(value.size), float(np.sqrt(planner.efficiency))
    for begin, end, known in _days(planner, foresight=foresight):
        product = np.arange(known.size) // product_steps
        count = np.bincount(product)
        mean = np.bincount(product, value[known]) / count
        plan_kw = planner.of_prices(mean[product], begin, stored_kwh)
        day_kw = (np.bincount(product, plan_kw) / count)[product][: end - begin]
        day_kw[np.abs(day_kw) < _MIN_POSITION * planner.power_kw] = 0.0
        schedule[begin:end] = day_kw
        drawn = np.where(day_kw > 0.0, day_kw / one_way, day_kw * one_way).sum() * planner.dt_h
        stored_kwh = float(np.clip(stored_kwh - drawn, 0.0, planner.energy_kwh))
    return schedule


def _days(planner: Arbitrage, *, foresight: bool) -> Iterator[tuple[int, int, npt.NDArray[np.int64]]]:
    """Yield start and end of each day, and the steps whose prices are used for its look-ahead."""
    size, day_steps = planner.days.size, round(24.0 / planner.dt_h)
    first = np.flatnonzero(np.diff(planner.days, prepend=planner.days[0] - 1)).tolist()
    for begin, end in zip(first, [*first[1:], size], strict=True):
        ahead = np.arange(begin, min(begin + planner.look_ahead_steps, size))
        known = ahead if foresight else ahead - day_steps * (1 + (ahead - begin) // day_steps)
        if foresight or begin > 0:
            yield begin, end, np.maximum(known, 0)


class AuctionForecast:
    """Forecast of the last market by the preceding auction, whose prices are known from the afternoon before.

    The present price is the market price. Days whose auction is not yet cleared have the prices of the last
    cleared day.

    Parameters
    ----------
    values : array, shape (n_steps,)
        Prices of the market.
    auction : array, shape (n_steps,)
        Prices of the auction.
    days : array of int, shape (n_steps,)
        Number of the trading day of each step.
    dt_h : float
        Control step [h].
    """

    def __init__(self, values: Array, auction: Array, days: npt.NDArray[np.int64], dt_h: float):
        self._values, self._auction, self._days = values, auction, days
        self._day_steps, self._cleared_steps = round(24.0 / dt_h), round(_LEAD_TIME_H / dt_h)

    def ahead(self, step: int, horizon: int) -> Array:
        """See :class:`bess.dispatch.Forecast`."""
        later = np.arange(step, min(step + horizon, self._values.size))
        day = self._days[min(step + self._cleared_steps, self._days.size - 1)]
        known = int(np.searchsorted(self._days, day, side="right"))
        source = later - self._day_steps * np.maximum(0, -(-(later - known + 1) // self._day_steps))
        expected = np.where(source < 0, self._values[step], self._auction[np.maximum(source, 0)])
        expected[0] = self._values[step]
        return np.asarray(expected)


def reserve_blocks(
    capacity_price_eur_mw_h: Array,
    price_eur_mwh: Array,
    planner: Arbitrage,
    *,
    blocks: npt.NDArray[np.int64],
    max_reserve_kw: float,
    stored_kwh: float,
    foresight: bool,
) -> Array:
    r"""Return the reserve to sell in each four-hour block, chosen day by day together with the trade.

    The store program of the trade gets the reserve :math:`0 \le C_b \le C` of each block :math:`b` at its
    price :math:`\rho_b`, and :math:`c_t + C_b \le P`, :math:`d_t + C_b \le P`. The energy of the reserve is
    kept for its largest value at all times.

    Parameters
    ----------
    capacity_price_eur_mw_h, price_eur_mwh : ndarray, shape (n_steps,)
        Prices of reserve and of energy.
    planner : Arbitrage
        The trade, without reserve; its prices are not used.
    blocks : array of int, shape (n_steps,)
        Number of the block of each step, ascending; none lasts over midnight.
    max_reserve_kw : float
        Largest reserve.
    stored_kwh : float
        Energy for trade at the start.
    foresight : bool
        Whether prices are known. Otherwise, prices of the day before are used, and day one has no reserve.

    Returns
    -------
    ndarray, shape (n_steps,)
        Reserve [kW].
    """
    reserve_kw, dt_h = np.zeros(price_eur_mwh.size), planner.dt_h
    for begin, end, known in _days(planner, foresight=foresight):
        price, row = price_eur_mwh[known], np.arange(known.size)
        weight = planner.weight(price)
        program = planner.program(price, begin, stored_kwh)
        block = blocks[begin : begin + row.size] - blocks[begin]
        income = np.bincount(block, weight * dt_h * capacity_price_eur_mw_h[known])
        sold = program.add(income.size, cost=-income, upper=max_reserve_kw / planner.power_kw)
        for power in (program.charge, program.discharge):
            program.at_most(np.ones(row.size), (power, 1.0), (sold[block], 1.0))
        best = one_direction(program, price)
        reserve_kw[begin:end] = planner.power_kw * best.added[block][: end - begin]
        stored_kwh = planner.power_kw * float(best.stored[end - begin - 1])
    return reserve_kw


def four_hour_blocks(index: pd.DatetimeIndex, time_zone: str | tzinfo) -> npt.NDArray[np.int64]:
    """Return the number of the local four-hour block of each time, six for each day of 23 to 25 h."""
    return np.asarray(6 * calendar_days(index, time_zone) + index.tz_convert(time_zone).hour // 4)
