"""State grid of the aggregate store: transitions for each power, and values of states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from scipy import sparse

from bess.arrays import Array
from bess.dispatch.aggregate import ENERGY, Aggregate
from bess.dispatch.cycle_depth_cost import CycleDepthCost

_ENERGIES: Final = 61
"""Points over the stored energy."""

_POWERS: Final = 8
"""Powers in each direction, in equal distances."""

_FROM_DERATING_K: Final = (
    *(-45.0, -30.0, -20.0, -13.0, -9.0, -7.0), *np.arange(-5.0, 3.1, 0.5), *(6.0, 12.0, 20.0, 35.0)
)  # fmt: skip
"""Temperatures from that at which derating begins: a step moves little there, and each half degree costs."""

_WITHOUT_DERATING_C: Final = (0.0, 15.0, 25.0, 35.0, 45.0, 60.0)

_ROUNDING_KWH: Final = 1e-6
"""What a plant that rests may seem to cycle."""

_NOTHING: Final = 1e-12

Places = npt.NDArray[np.int64]


class StoreState(NamedTuple):
    """State of the plant as one store.

    Attributes
    ----------
    energy_kwh, temperature_c : ndarray
        Stored energy and mean temperature.
    depth : ndarray
        Depth of the present discharge, relative to capacity.
    """

    energy_kwh: Array
    temperature_c: Array
    depth: Array


class Grid(StoreState):
    """Grid points of each state variable; one point of depth if wear is independent of it."""

    @classmethod
    def of(cls, plant: Aggregate, energy_kwh: float, depth: Array) -> Self:
        """Return the grid for a plant that uses at most ``energy_kwh``."""
        derated_c = plant.derating_begins_c
        warm_c = _WITHOUT_DERATING_C if derated_c is None else derated_c + np.array(_FROM_DERATING_K)
        return cls(np.linspace(0.0, energy_kwh, _ENERGIES), np.asarray(warm_c), depth)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of points."""
        return self.energy_kwh.size, self.temperature_c.size, self.depth.size

    def corners(self, state: StoreState) -> tuple[Places, Array]:
        """Return the grid points around states (flat indices) and their weights, ``(n, n_corners)``."""
        place = np.zeros((state[0].size, 1), dtype=np.int64)
        weight = np.ones((state[0].size, 1))
        for points, at in zip(self, state, strict=True):
            if points.size > 1:
                low, share = _around(points, at)
                below, share = place * points.size + low[:, None], share[:, None]
                place = np.concatenate([below, below + 1], axis=1)
                weight = np.concatenate([weight * (1.0 - share), weight * share], axis=1)
        return place, weight


def _around(points: Array, at: Array) -> tuple[Places, Array]:
    low = points[1:-1].searchsorted(at, side="right")
    share = (at - points[low]) / (points[low + 1] - points[low])
    return low, np.minimum(np.maximum(share, 0.0), 1.0)


@dataclass(frozen=True)
class Offer:
    """Revenue and cost of energy in a block of steps of equal price.

    Attributes
    ----------
    eur : ndarray, shape (4,)
        Income of a kWh discharged, of one charged, of one that derating takes, and of holding
        a kWh for an hour; costs are negative.
    ambient_c : float
        Mean ambient temperature.
    """

    eur: Array
    ambient_c: float


class Moves:
    """Transitions of the plant for each of several powers in a block of steps, by its control model.

    Parameters
    ----------
    plant : Aggregate
        The plant.
    grid : Grid
        States to start from.
    power_kw : tuple of float
        Largest power of charging, and of discharging.
    steps : int
        Control steps of the block.
    by_throughput : bool
        Whether cycles count the mean of charged and discharged AC energy; else what leaves the store.
    """

    def __init__(
        self, plant: Aggregate, grid: Grid, power_kw: tuple[float, float], steps: int, *, by_throughput: bool
    ):
        self._hours, self._grid, self._capacity_kwh = steps * plant.dt_h, grid, plant.capacity_kwh
        self._by_throughput, self._ambient_c = by_throughput, plant.system.reference_temperature_c
        self._cooled = 1.0 - np.exp(-plant.cooling_per_h * self._hours)
        charge_kw, discharge_kw = power_kw
        share = np.linspace(-1.0, 1.0, 2 * _POWERS + 1)
        power = share * np.where(share < 0.0, charge_kw, discharge_kw)
        flows = plant.flows_over(grid.energy_kwh, grid.temperature_c, power, steps)
        # The part of a move that fills the store as far as it is used.
        held, end = grid.energy_kwh[:, None, None], flows[..., ENERGY]
        part = 1.0 - np.maximum(end - grid.energy_kwh[-1], 0.0) / np.maximum(end - held, 1e-9)
        flows[..., :ENERGY] *= part[..., None]
        flows[..., ENERGY] = held + part * (end - held)
        # One row for each power, energy, temperature and depth.
        shape = (power.size, *grid.shape)
        flows = np.moveaxis(flows, 2, 0)[:, :, :, None]
        self._flows = np.broadcast_to(flows, (*shape, flows.shape[-1])).reshape(
            power.size, -1, flows.shape[-1]
        )
        held, depth = (
            np.broadcast_to(part, shape).ravel() for part in (grid.energy_kwh[:, None, None], grid.depth)
        )
        self._rows = self._moved(self._flows.reshape(-1, flows.shape[-1]), held, depth)
        self._depth = depth
        place, weight = grid.corners(self._rows.after)
        ends = np.arange(0, place.size + 1, place.shape[1], dtype=np.int32)
        self._matrix = sparse.csr_array(
            (weight.ravel(), place.ravel().astype(np.int32), ends),
            shape=(len(place), int(np.prod(grid.shape))),
        )

    def wear_eur(self, depths: CycleDepthCost) -> Array:
        """Return the wear cost of every row by its depth."""
        return depths.discharge_eur(self._depth, self._rows.drawn)

    def income_eur(self, offer: Offer, wear_eur: Array, shadow_eur: Array) -> Array:
        """Return the income of every row at each price ``shadow_eur`` per kWh cycled."""
        earned = self._rows.amounts @ offer.eur - wear_eur
        return np.asarray(earned[:, None] - self._rows.cycled_kwh[:, None] * shadow_eur)

    def values(self, after: Array, income_eur: Array, ambient_c: float) -> Array:
        """Return the values of grid states before a block, ``(n_states, n_shadows)``.

        ``after`` are the values after the block, ``income_eur`` the income of the rows.
        """
        points = self._grid.temperature_c
        low, share = _around(points, points + self._cooled * (ambient_c - self._ambient_c))
        cube = after.reshape(self._grid.shape[0], points.size, -1)
        share = share[:, None]
        worth = self._matrix @ ((1.0 - share) * cube[:, low] + share * cube[:, low + 1]).reshape(after.shape)
        worth += income_eur
        return np.asarray(worth.reshape(-1, *after.shape).max(axis=0))

    def best(
        self,
        after: Array,
        offer: Offer,
        depths: CycleDepthCost,
        state: StoreState,
        shadow_eur: float,
        left_kwh: float,
    ) -> tuple[float, StoreState, float]:
        """Return the signed power to request in a state, the next state, and the cycled energy.

        ``after`` is what the states of the grid are worth after the block, shape ``(n_states,)``. Powers that
        cycle more than ``left_kwh`` are left out.
        """
        place, weight = self._grid.corners(state)
        flows = weight[0] @ self._flows[:, place[0]]
        rows = self._moved(flows, state.energy_kwh, state.depth)
        rows.after.temperature_c[:] += self._cooled * (offer.ambient_c - self._ambient_c)
        place, weight = self._grid.corners(rows.after)
        worth = rows.amounts @ offer.eur - depths.discharge_eur(state.depth, rows.drawn)
        worth += (weight * after[place]).sum(axis=1) - rows.cycled_kwh * shadow_eur
        chosen = int(np.argmax(np.where(rows.cycled_kwh <= left_kwh + _ROUNDING_KWH, worth, -np.inf)))
        end = StoreState(*(part[chosen : chosen + 1] for part in rows.after))
        return float(flows[chosen, 0]), end, float(rows.cycled_kwh[chosen])

    def _moved(self, flows: Array, held_kwh: Array, depth: Array) -> _Rows:
        """Return the rows of given flows from states of these energies and depths."""
        _, delivered_kw, derated_kw, standby_kw, energy_kwh, temperature_c = flows.T
        sold, bought = np.maximum(delivered_kw, 0.0), np.maximum(-delivered_kw, 0.0)
        amounts = self._hours * np.stack([sold, bought + standby_kw, derated_kw, energy_kwh], axis=1)
        change = (energy_kwh - held_kwh) / self._capacity_kwh
        drawn, filled, held = np.maximum(-change, 0.0), np.maximum(change, 0.0), held_kwh / self._capacity_kwh
        # What is charged lies above what is stored: the mean depth of all of it is that of both.
        refilled = np.maximum(depth - filled, 0.0) * held / np.maximum(held + filled, _NOTHING)
        deeper = np.minimum(np.where(filled > 0.0, refilled, depth + drawn), self._grid.depth[-1])
        cycled_kwh = (
            0.5 * self._hours * (sold + bought) if self._by_throughput else drawn * self._capacity_kwh
        )
        return _Rows(amounts, drawn, cycled_kwh, StoreState(energy_kwh, temperature_c.copy(), deeper))


@dataclass(frozen=True)
class _Rows:
    """Settled energies, share of capacity discharged, cycled energy, and states after the block."""

    amounts: Array
    drawn: Array
    cycled_kwh: Array
    after: StoreState
