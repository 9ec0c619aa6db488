"""Prices of a plan: losses in kWh, or in EUR at the prices over the prediction horizon."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bess.arrays import Array, ByValue
from bess.control.objectives import Objectives
from bess.errors import InputError
from bess.system.terms import SettlementTerms
from bess.units import KWH_PER_MWH

MIN_LOSS_PRICE = 0.01
"""Minimum price of losses, as a share of the mean magnitude of the purchase price over the horizon: otherwise
losses would be ignored while energy is free."""

SOC_DEPENDENT_WEIGHT = 0.1
"""Weight of availability losses for SOC-dependent demand, relative to fixed demand. At 0, plans rely on full
or empty strings to limit the power; at 0.5, they waste energy to create headroom."""


@dataclass(frozen=True, eq=False)
class PlanPrices(ByValue):
    """Costs of the steps of a plan; the unit is kWh (kind ``energy``) or EUR (kind ``money``).

    Attributes
    ----------
    losses : ndarray, shape (n_steps, 4)
        Price of availability, derating, inverter and battery loss [cost/kWh].
    wear : ndarray, shape (n_strings,)
        Price of the charge throughput of a string, in either direction [cost/Ah].
    start : float
        Price of an inverter start [cost].
    """

    losses: Array
    wear: Array
    start: float = 0.0

    @classmethod
    def energy(cls, objectives: Objectives, n_strings: int, n_steps: int) -> PlanPrices:
        """Weights of the objectives, equal in all steps (docs/foresight.md, eq. F1)."""
        weights = np.array([objective.weight for objective in objectives.members])
        start = objectives.start_kwh or 0.0
        return cls(np.broadcast_to(weights, (n_steps, 4)).copy(), np.zeros(n_strings), start)

    @classmethod
    def money(
        cls,
        objectives: Objectives,
        terms: SettlementTerms,
        demand_kw: Array,
        price_eur_mwh: Array,
        wear_eur_ah: Array,
    ) -> PlanPrices:
        r"""Prices that follow from the settlement terms (docs/foresight.md, eq. F2).

        Undelivered energy costs the shortfall price of the settlement. The demand is fixed, so a plan does
        not change the energy traded in a step. Losses reduce the stored energy in both directions, and the
        plant buys this energy when it next charges. With buying price :math:`\pi + f_c`, the price of a loss
        in step ``t`` is the power-weighted mean over the charging steps from ``t`` on. If the forecast
        contains no charging, the price is the median over the horizon. A start costs ``start_eur`` of the
        settlement and ``start_kwh`` of the objectives at the mean price of a loss.

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
            Marginal wear cost of each string [EUR/Ah].

        Raises
        ------
        InputError
            Prices and demand are not finite arrays of equal length.
        """
        if price_eur_mwh.ndim != 1 or price_eur_mwh.shape != demand_kw.shape or not price_eur_mwh.size:
            raise InputError(
                f"prices of shape {price_eur_mwh.shape} and a demand of shape {demand_kw.shape} need one "
                "length"
            )
        if not (np.isfinite(price_eur_mwh).all() and np.isfinite(demand_kw).all()):
            raise InputError("prices and demand of a plan must be finite")
        undelivered = terms.shortfall_price_eur_mwh(price_eur_mwh) / KWH_PER_MWH
        buy = terms.charge_price_eur_mwh(price_eur_mwh) / KWH_PER_MWH
        usual = float(np.abs(buy).mean()) or float(undelivered.mean())
        loss = np.maximum(_replacement_price(buy, demand_kw), MIN_LOSS_PRICE * usual)
        losses = np.empty((price_eur_mwh.size, 4))
        losses[:, :2], losses[:, 2:] = undelivered[:, None], loss[:, None]
        weights = np.array([objective.weight for objective in objectives.members])
        start_eur = terms.start_eur + (objectives.start_kwh or 0.0) * float(loss.mean())
        return cls(losses * weights, wear_eur_ah, start_eur)

    def for_soc_dependent_demand(self) -> PlanPrices:
        """Return these prices for SOC-dependent demand (docs/foresight.md).

        Availability losses after the first step are weighted with :data:`SOC_DEPENDENT_WEIGHT`: a plant that
        is full or empty will receive less demand.
        """
        losses = self.losses.copy()
        losses[1:, 0] *= SOC_DEPENDENT_WEIGHT
        return replace(self, losses=losses)


def _replacement_price(buy: Array, demand_kw: Array) -> Array:
    """Price of replacing the losses of each step, in the unit of the purchase price ``buy``."""
    charging_kw = np.maximum(-demand_kw, 0.0)
    # Sums from each step to the end.
    power = np.cumsum(charging_kw[::-1])[::-1]
    paid = np.cumsum((charging_kw * buy)[::-1])[::-1]
    median = np.full(buy.size, np.median(buy))
    return np.asarray(np.divide(paid, power, out=median, where=power > 0.0))
