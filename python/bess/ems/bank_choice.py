"""The store cut into banks by depth: where resistance climbs, and where deeper cycles wear more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from bess.ems.aggregate import Aggregate
from bess.ems.store_program import Banks
from bess.numbers import Array
from bess.units import HOURS_PER_DAY, KWH_PER_MWH
from bess.wear import MarginalWear

_DEPTHS: Final = (0.25, 0.5, 0.75, 1.0)
"""Ends of the segments of depth whose wear is told apart, where it depends on depth."""

_HOLDING_SOC: Final = (0.2, 0.8)
"""Between these the price of a day is taken to be linear in SOC."""

_POWER_SHARE: Final = 0.6
"""Share of the plant's power at which the heat of deep banks is taken."""


@dataclass(frozen=True)
class Depths:
    """What cycles wear, by depth, for the plant as a whole; rates frozen at the state of a plan.

    Attributes
    ----------
    by_energy_eur_kwh : float
        Price of each kWh discharged (AC), whatever the depth.
    capacity_kwh : float
        Energy of a cycle of depth 1.
    depth, cycle_eur : ndarray, shape (n_depths,)
        Price of a cycle over its depth, from ``(0, 0)``, beside the former; convex.
    holding_eur_kwh_h : float
        Price of holding a kWh for an hour: calendar wear that grows with SOC.
    """

    by_energy_eur_kwh: float
    capacity_kwh: float
    depth: Array
    cycle_eur: Array
    holding_eur_kwh_h: float

    @classmethod
    def of(cls, plant: Aggregate, wear: MarginalWear) -> Self:
        """Take the means over the strings, at their temperatures."""
        energy_kwh, share = plant.string_energy_kwh, plant.string_energy_kwh / plant.capacity_kwh
        wears = (string.wear for string in plant.system.strings)
        said = [each.eur_per_mwh if each.model != "none" else None for each in wears]
        # A price per MWh is planned with as it stands, whatever the cell model would say.
        by_model = np.array([price is None for price in said])
        flat = np.array([0.0 if price is None else price / KWH_PER_MWH for price in said])
        depth, temperature_c = np.array(_DEPTHS), wear.state.temperature_c[:, None]
        rate = wear.cycling_eur_kwh(depth, temperature_c)
        cycle_eur = (by_model * energy_kwh) @ (rate * depth)
        marginal = np.maximum.accumulate(np.diff(cycle_eur, prepend=0.0) / np.diff(depth, prepend=0.0))
        empty, full = (np.full((share.size, 1), soc) for soc in _HOLDING_SOC)
        day_eur = by_model @ (
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
    def marginal_eur_kwh(self) -> Array:
        """Price of a kWh drawn in each segment of depth."""
        return np.diff(self.cycle_eur) / (np.diff(self.depth) * self.capacity_kwh)

    def cost_eur(self, discharged_kwh: Array, energy_kwh: Array, dt_h: float) -> float:
        """Return what a trajectory of stored energy wears.

        ``discharged_kwh`` (AC) has one value for each step, ``energy_kwh`` one more. Every discharge from one
        turning point to the next counts as a cycle, which is the upper end of what rainflow counting gives.
        """
        turns = np.flatnonzero(np.diff(np.sign(np.diff(energy_kwh))) != 0) + 1
        corners = energy_kwh[np.r_[0, turns, energy_kwh.size - 1]]
        drawn = np.maximum(-np.diff(corners), 0.0) / self.capacity_kwh
        cycles_eur = np.interp(drawn, self.depth, self.cycle_eur).sum()
        held_eur = self.holding_eur_kwh_h * dt_h * energy_kwh[1:].sum()
        return float(discharged_kwh.sum() * self.by_energy_eur_kwh + cycles_eur + held_eur)


def banks_of(plant: Aggregate, depths: Depths, energy_kwh: float) -> Banks:
    """Cut ``energy_kwh``, of which the lowest part is the plant's lowest, into banks from the top down."""
    size, factor = plant.deep_banks
    bottom = np.maximum(np.cumsum(size) - (plant.capacity_kwh - energy_kwh), 0.0)
    wears = np.ptp(depths.marginal_eur_kwh) > 0.0
    segments = depths.depth[1:] * plant.capacity_kwh
    edges = np.unique(np.r_[bottom, segments[segments < energy_kwh] if wears else []])
    sizes = np.diff(edges, prepend=0.0)
    edges, sizes = edges[sizes > 1e-6 * energy_kwh], sizes[sizes > 1e-6 * energy_kwh]
    middle = edges - 0.5 * sizes
    growth = factor[np.searchsorted(bottom, middle)] - factor[0]
    segment = np.minimum(np.searchsorted(segments, middle), segments.size - 1)
    power_kw = _POWER_SHARE * plant.power_kw
    heat = [np.interp(power_kw, curve.power_kw, curve.heat_kw) / power_kw for curve in plant.curves]
    return Banks(sizes, growth * heat[0], growth * heat[1], depths.marginal_eur_kwh[segment])
