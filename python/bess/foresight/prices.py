"""What a plan counts: losses in kWh, or in EUR at the prices of the steps ahead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bess.parameters.terms import Terms
from bess.split.money import split_prices
from bess.split.objectives import Objectives

Array = NDArray[np.float64]

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
        return cls(np.broadcast_to(weights, (n_steps, 4)).copy(), np.zeros(n_strings))

    @classmethod
    def money(
        cls,
        objectives: Objectives,
        terms: Terms,
        demand_kw: Array,
        price_eur_mwh: Array,
        wear_eur_ah: Array,
    ) -> PlanPrices:
        """Prices of :func:`bess.split.money.split_prices` (docs/foresight.md, eq. F2).

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
        """
        prices = split_prices(terms, price_eur_mwh, demand_kw)
        missing = prices.shortfall_eur_kwh
        lost = np.maximum(prices.loss_eur_kwh, LEAST_LOSS_EUR_KWH)
        losses = np.stack([missing, missing, lost, lost], axis=1)
        weights = np.array([objective.weight for objective in objectives.members])
        return cls(losses * weights, wear_eur_ah, prices.start_eur)

    def following_store(self) -> PlanPrices:
        """The same for a demand that follows from what is in store (docs/foresight.md).

        Availability losses after the first step count :data:`FOLLOWING_SHARE`: what will find no room, or
        nothing left, will not be asked.
        """
        losses = self.losses.copy()
        losses[1:, 0] *= FOLLOWING_SHARE
        return replace(self, losses=losses)
