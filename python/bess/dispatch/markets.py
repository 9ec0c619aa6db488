"""Positions in auctions that are cleared before the last market of a plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array
from bess.dispatch.arbitrage import Arbitrage

_CLEARED_H: Final = 9.0
"""Time before a day at which its auction is cleared [h]: 15:00 of the day before."""

_NOTHING: Final = 1e-9
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

    So one program over all markets falls apart into one store program for each. With foresight the schedule
    of an auction is the one that earns most at the difference to the next price. Without, the next price is
    expected to be that of the auction, and the schedule is the one that earns most at the prices of the day
    before (rolling intrinsic). Every schedule is one that the store could deliver, from where the one of the
    day before ended; what the plant does is decided in the last market, :math:`s_K`.

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
        Whether prices are known; else those of the day before are taken, and the first day has no position.

    Returns
    -------
    ndarray, shape (n_steps, n_auctions)
        Positions [kW], positive = sold.
    """
    first = np.flatnonzero(np.diff(planner.days, prepend=planner.days[0] - 1))
    schedules = [np.zeros(planner.days.size)]
    for own, following, steps in zip(prices, prices[1:], product_steps, strict=False):
        value = own - following if foresight else own
        schedules.append(_schedule(value, planner, first, steps, stored_kwh, foresight=foresight))
    return np.stack([after - before for before, after in zip(schedules, schedules[1:], strict=False)], axis=1)


def _schedule(
    value: Array,
    planner: Arbitrage,
    first: npt.NDArray[np.int64],
    product_steps: int,
    stored_kwh: float,
    *,
    foresight: bool,
) -> Array:
    """Schedule that earns most at ``value``, of products of so many steps."""
    schedule, one_way = np.zeros(value.size), float(np.sqrt(planner.efficiency))
    day_steps = round(24.0 / planner.dt_h)
    for begin, end in zip(first, [*first[1:], value.size], strict=True):
        ahead = np.arange(begin, min(begin + planner.look_ahead_steps, value.size))
        known = ahead if foresight else ahead - day_steps * (1 + (ahead - begin) // day_steps)
        if known[0] < 0:
            continue
        product = (ahead - begin) // product_steps
        count = np.bincount(product)
        mean = np.bincount(product, value[known]) / count
        plan_kw = planner.of_prices(mean[product], int(begin), stored_kwh)
        day_kw = (np.bincount(product, plan_kw) / count)[product][: end - begin]
        day_kw[np.abs(day_kw) < _NOTHING * planner.power_kw] = 0.0
        schedule[begin:end] = day_kw
        drawn = np.where(day_kw > 0.0, day_kw / one_way, day_kw * one_way).sum() * planner.dt_h
        stored_kwh = float(np.clip(stored_kwh - drawn, 0.0, planner.energy_kwh))
    return schedule


class AuctionForecast:
    """Forecast of the last market by the auction before it: its prices are known from the afternoon before.

    The present price is that of the market. Of days whose auction is not cleared yet the prices of the last
    day that is are taken.

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
        self._day_steps, self._cleared_steps = round(24.0 / dt_h), round(_CLEARED_H / dt_h)

    def ahead(self, step: int, horizon: int) -> Array:
        """See :class:`bess.dispatch.Forecast`."""
        later = np.arange(step, min(step + horizon, self._values.size))
        day = self._days[min(step + self._cleared_steps, self._days.size - 1)]
        known = int(np.searchsorted(self._days, day, side="right"))
        source = later - self._day_steps * np.maximum(0, -(-(later - known + 1) // self._day_steps))
        seen = np.where(source < 0, self._values[step], self._auction[np.maximum(source, 0)])
        seen[0] = self._values[step]
        return np.asarray(seen)
