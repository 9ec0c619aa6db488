"""Wear cost of cycles of the aggregate store by depth of cycle."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from bess.arrays import Array
from bess.control.wear import MarginalWear
from bess.dispatch.aggregate import Aggregate
from bess.units import HOURS_PER_DAY, KWH_PER_MWH

_DEPTHS: Final = (0.25, 0.5, 0.75, 1.0)
"""Upper ends of the depth segments with separate wear prices, if wear depends on depth."""

_HOLDING_SOC: Final = (0.2, 0.8)
"""SOC range over which calendar wear cost is approximated as linear."""


@dataclass(frozen=True)
class CycleDepthCost:
    """Wear cost of cycles by depth for the whole plant, with rates frozen at the state of a plan."""

    by_energy_eur_kwh: float
    """Price of each kWh discharged (AC), at any depth."""
    capacity_kwh: float
    """Energy of a cycle of depth 1."""
    depth: Array
    cycle_eur: Array
    """``(n_depths,)``: additional price of a cycle over its depth, from ``(0, 0)``; convex."""
    holding_eur_kwh_h: float
    """Price of holding a kWh for an hour: calendar wear that grows with SOC."""

    @classmethod
    def of(cls, plant: Aggregate, wear: MarginalWear) -> Self:
        """Return the mean over the strings in service at their temperatures."""
        energy_kwh, share = plant.string_energy_kwh, plant.string_energy_kwh / plant.capacity_kwh
        wears = (string.wear for string in plant.system.strings)
        given = [each.eur_per_mwh if each.model != "none" else None for each in wears]
        # A price per MWh replaces the wear rate of the cell model.
        by_model = np.array([price is None for price in given])
        flat = np.array([0.0 if price is None else price / KWH_PER_MWH for price in given])
        depth, temperature_c = np.array(_DEPTHS), wear.state.temperature_c[:, None]
        rate = wear.cycling_eur_kwh(depth, temperature_c)
        cycle_eur = (by_model * energy_kwh) @ (rate * depth)
        marginal = np.maximum.accumulate(np.diff(cycle_eur, prepend=0.0) / np.diff(depth, prepend=0.0))
        empty, full = (np.full((share.size, 1), soc) for soc in _HOLDING_SOC)
        day_eur = (by_model & (energy_kwh > 0.0)) @ (
            wear.calendar_eur_day(full, temperature_c) - wear.calendar_eur_day(empty, temperature_c)
        )
        between_kwh = (_HOLDING_SOC[1] - _HOLDING_SOC[0]) * plant.capacity_kwh
        return cls(
            by_energy_eur_kwh=float((share * flat).sum()),
            capacity_kwh=plant.capacity_kwh,
            depth=np.r_[0.0, depth],
            cycle_eur=np.r_[0.0, np.cumsum(marginal * np.diff(depth, prepend=0.0))],
            holding_eur_kwh_h=max(0.0, float(day_eur.sum()) / (between_kwh * HOURS_PER_DAY)),
        )

    @property
    def points(self) -> Array:
        """Depth grid of the dynamic program: one point if wear is independent of depth."""
        return self.depth if np.ptp(self.marginal_eur_kwh) > 0.0 else self.depth[:1]

    @property
    def marginal_eur_kwh(self) -> Array:
        """Return the price of a kWh discharged in each segment of depth."""
        return np.diff(self.cycle_eur) / (np.diff(self.depth) * self.capacity_kwh)

    @property
    def curve_eur(self) -> tuple[Array, Array]:
        """Return depths and the price of a cycle of each, without the price of energy.

        Beyond a depth of 1, reached by grid points around a state only, the last slope is continued.
        """
        beyond_eur = self.cycle_eur[-1] + self.capacity_kwh * self.marginal_eur_kwh[-1]
        return np.r_[self.depth, 2.0], np.r_[self.cycle_eur, beyond_eur]

    def cost_eur(self, discharged_kwh: Array, energy_kwh: Array, dt_h: float) -> float:
        """Return the wear cost of a trajectory of stored energy.

        ``discharged_kwh`` (AC) has one value for each step, ``energy_kwh`` one more. Every discharge from one
        turning point to the next counts as a cycle, which is an upper bound of rainflow counting.
        """
        turns = np.flatnonzero(np.diff(np.sign(np.diff(energy_kwh))) != 0) + 1
        corners = energy_kwh[np.r_[0, turns, energy_kwh.size - 1]]
        drawn = np.maximum(-np.diff(corners), 0.0) / self.capacity_kwh
        cycles_eur = np.interp(drawn, self.depth, self.cycle_eur).sum()
        holding_eur = self.holding_eur_kwh_h * dt_h * energy_kwh[1:].sum()
        return float(discharged_kwh.sum() * self.by_energy_eur_kwh + cycles_eur + holding_eur)
