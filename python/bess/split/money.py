"""Prices for a split in EUR: what a kWh not delivered, a kWh lost and a start cost in each step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.errors import InputError
from bess.parameters.terms import Terms
from bess.units import KWH_PER_MWH

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SplitPrices:
    """Prices of each step of a horizon; arrays of shape ``(n_steps,)``, none below 0.

    Wear is not among them: its marginal rates are those of :func:`bess.wear.marginal`, string by string.

    Attributes
    ----------
    shortfall_eur_kwh : ndarray
        A kWh asked for and not delivered (availability and derating loss).
    loss_eur_kwh : ndarray
        A kWh lost in inverters and batteries: the energy that has to be bought again.
    start_eur : float
        A start of an inverter.
    """

    shortfall_eur_kwh: Array
    loss_eur_kwh: Array
    start_eur: float


def split_prices(terms: Terms, price_eur_mwh: ArrayLike, demand_kw: ArrayLike) -> SplitPrices:
    r"""Return the prices with which the settlement would count what a split does.

    The demand is given, so a split does not change what is sold or bought in a step: what it loses is missing
    in store, whichever the direction. It is bought again when the plant charges next. So with buying price
    :math:`\pi + f_c`, the price of a loss in step ``t`` is the mean over the charging steps from ``t`` on,
    weighted with their power; where no charging is foreseen, the median over the horizon. Without a demand
    that is known so far, a day of it, or its forecast, is enough.

    Parameters
    ----------
    terms : Terms
        What was agreed on beside the price.
    price_eur_mwh : array_like, shape (n_steps,)
        Market price of each step.
    demand_kw : array_like, shape (n_steps,)
        Demand of each step as foreseen, positive = discharge.

    Raises
    ------
    InputError
        The two are not finite arrays of one length.

    Examples
    --------
    >>> from bess.parameters.terms import Terms
    >>> prices = split_prices(Terms(), [20.0, 90.0, 30.0], [-50.0, 80.0, -50.0])
    >>> prices.loss_eur_kwh.round(3).tolist()
    [0.025, 0.03, 0.03]
    >>> prices.shortfall_eur_kwh.tolist()
    [0.07, 0.14, 0.08]
    """
    price = np.asarray(price_eur_mwh, dtype=np.float64)
    demand = np.asarray(demand_kw, dtype=np.float64)
    if price.ndim != 1 or price.shape != demand.shape or not price.size:
        raise InputError(
            f"prices of shape {price.shape} and a demand of shape {demand.shape} need one length"
        )
    if not (np.isfinite(price).all() and np.isfinite(demand).all()):
        raise InputError("prices and demand of a split must be finite")
    buy = terms.charge_price_eur_mwh(price)
    charging = np.maximum(-demand, 0.0)
    # Sums from each step to the end.
    power = np.cumsum(charging[::-1])[::-1]
    paid = np.cumsum((charging * buy)[::-1])[::-1]
    again = np.divide(paid, power, out=np.full(price.size, np.median(buy)), where=power > 0.0)
    return SplitPrices(
        shortfall_eur_kwh=terms.shortfall_price_eur_mwh(price) / KWH_PER_MWH,
        loss_eur_kwh=np.maximum(again, 0.0) / KWH_PER_MWH,
        start_eur=terms.start_eur,
    )
