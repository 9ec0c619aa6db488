"""What a plan counts: losses in kWh, or in EUR at the prices of the steps ahead."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace

import numpy as np

from bess.errors import InputError
from bess.numbers import Array
from bess.parameters.terms import Terms
from bess.split.objectives import Objectives
from bess.units import KWH_PER_MWH

LEAST_LOSS_EUR_KWH = 1e-3
"""What a kWh lost costs at least: where energy is free, nothing else would tell a wasteful plan from another
one."""

FOLLOWING_SHARE = 0.1
"""Price of a kWh that a string which is full or empty will not take or give, against one that is asked
whatever is in store. At nothing, plans count on strings to refuse; at a half, they waste energy to have
room."""


@dataclass(frozen=True)
class PlanPrices:
    """Costs of the steps of a plan; the unit is kWh (kind ``energy``) or EUR (kind ``money``).

    Attributes
    ----------
    losses : ndarray, shape (n_steps, 4)
        A kWh of availability, derating, inverter and battery loss [cost/kWh].
    wear : ndarray, shape (n_strings,)
        An Ah of string current in either direction [cost/Ah].
    start : float
        A start of an inverter [cost].
    """

    losses: Array
    wear: Array
    start: float = 0.0

    @classmethod
    def energy(cls, objectives: Objectives, n_strings: int, n_steps: int) -> PlanPrices:
        """Weights of the objectives, the same in every step (docs/foresight.md, eq. F1)."""
        weights = np.array([objective.weight for objective in objectives.members])
        start = objectives.start_kwh or 0.0
        return cls(np.broadcast_to(weights, (n_steps, 4)).copy(), np.zeros(n_strings), start)

    @classmethod
    def money(
        cls,
        objectives: Objectives,
        terms: Terms,
        demand_kw: Array,
        price_eur_mwh: Array,
        wear_eur_ah: Array,
    ) -> PlanPrices:
        r"""Prices with which the settlement would count what a plan does (docs/foresight.md, eq. F2).

        A shortfall costs what the settlement asks for it. The demand is given, so a plan does not change what
        is sold or bought in a step: what it loses is missing in store, whichever the direction. It is bought
        again when the plant charges next. So with buying price :math:`\pi + f_c`, the price of a loss in step
        ``t`` is the mean over the charging steps from ``t`` on, weighted with their power; where no charging
        is foreseen, the median over the horizon.

        Parameters
        ----------
        objectives
            Weights that multiply the prices of the four losses.
        terms
            Fees and penalties.
        demand_kw : ndarray, shape (n_steps,)
            Signed demand.
        price_eur_mwh : ndarray, shape (n_steps,)
            Market price.
        wear_eur_ah : ndarray, shape (n_strings,)
            Marginal wear of each string.

        Raises
        ------
        InputError
            Prices and demand are not finite arrays of one length.
        """
        if price_eur_mwh.ndim != 1 or price_eur_mwh.shape != demand_kw.shape or not price_eur_mwh.size:
            raise InputError(
                f"prices of shape {price_eur_mwh.shape} and a demand of shape {demand_kw.shape} need one "
                "length"
            )
        if not (np.isfinite(price_eur_mwh).all() and np.isfinite(demand_kw).all()):
            raise InputError("prices and demand of a plan must be finite")
        missing = terms.shortfall_price_eur_mwh(price_eur_mwh) / KWH_PER_MWH
        again = _bought_again_eur_mwh(terms.charge_price_eur_mwh(price_eur_mwh), demand_kw)
        lost = np.maximum(again / KWH_PER_MWH, LEAST_LOSS_EUR_KWH)
        losses = np.stack([missing, missing, lost, lost], axis=1)
        weights = np.array([objective.weight for objective in objectives.members])
        return cls(losses * weights, wear_eur_ah, terms.start_eur)

    def following_store(self) -> PlanPrices:
        """The same for a demand that follows from what is in store (docs/foresight.md).

        Availability losses after the first step count :data:`FOLLOWING_SHARE`: what will find no room, or
        nothing left, will not be asked.
        """
        losses = self.losses.copy()
        losses[1:, 0] *= FOLLOWING_SHARE
        return replace(self, losses=losses)


def _bought_again_eur_mwh(buy_eur_mwh: Array, demand_kw: Array) -> Array:
    """Price at which what is lost in each step is bought again [EUR/MWh]."""
    charging_kw = np.maximum(-demand_kw, 0.0)
    # Sums from each step to the end.
    power = np.cumsum(charging_kw[::-1])[::-1]
    paid = np.cumsum((charging_kw * buy_eur_mwh)[::-1])[::-1]
    median = np.full(buy_eur_mwh.size, statistics.median(buy_eur_mwh.tolist()))
    return np.asarray(np.divide(paid, power, out=median, where=power > 0.0))
