"""Estimated ageing in service, from the state of health of the system file.

Calendar ageing depends on time at the measured SOC and temperature, cycle ageing on charge throughput, both
at the rates of the string's cell model (:class:`bess.control.wear.MarginalWear`). A cycle depth of 0.5 is
assumed, because depths are known only at the end of a service. Resistance stays that of the system file.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bess import _core
from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.system import State, System

BLOCK_S: Final = 900.0
"""Time over which measurements are averaged."""
STEP_S: Final = 3600.0
"""Maximum step of calendar ageing, whose rate falls as it proceeds, over an outage of the service."""
DEPTH: Final = 0.5
C_RATE: Final = 0.3
LEAST: Final = 0.05
"""Minimum of the relative capacity."""


class Ageing(Checkpointed):
    """Capacity of each string relative to the system file; constant without a cell model."""

    _carried = ("_standing", "_cycling", "_gathered_s", "_sums")

    def __init__(self, system: System) -> None:
        begin = system.initial_state()
        self._ages = np.array([string.wear.cell_model for string in system.strings], dtype=bool)
        self._begin = begin.soh_capacity
        self.soh_resistance: Array = begin.soh_resistance
        self._energy_kwh = system.nominal_energy_kwh
        self._core = _core.Ageing(system.core)
        lost = np.maximum(1.0 - begin.soh_capacity, 0.0)
        share = np.array([string.wear.calendar_share for string in system.strings])
        self._standing, self._cycling = share * lost, (1.0 - share) * lost
        self._at_begin = self._standing + self._cycling
        self._gathered_s = 0.0
        self._sums = np.zeros((3, system.n_strings))

    @property
    def soh_capacity(self) -> Array:
        """Present capacity of each string relative to the system file."""
        lost = self._standing + self._cycling - self._at_begin
        return np.where(self._ages, np.maximum(self._begin - lost, LEAST), self._begin)

    def gather(self, state: State, power_kw: Array, elapsed_s: float, carried_s: float) -> None:
        """Add measurements of ``elapsed_s``; power flowed for ``carried_s`` of this time."""
        if not self._ages.any():
            return
        full_cycles = np.abs(power_kw) * carried_s / 3600.0 / (2.0 * self._energy_kwh * self.soh_capacity)
        by_time = elapsed_s * np.stack([state.soc, state.temperature_c])
        self._sums = self._sums + np.vstack([by_time, full_cycles])
        self._gathered_s += elapsed_s
        if self._gathered_s >= BLOCK_S:
            self._close_block()

    def _close_block(self) -> None:
        soc, temperature_c = (np.ascontiguousarray(row[:, None]) for row in self._sums[:2] / self._gathered_s)
        depth, c_rate = np.full_like(soc, DEPTH), np.full_like(soc, C_RATE)
        cycle = self._core.cyclic_rate(self._cycling, depth, soc, c_rate, temperature_c)[:, 0]
        steps = math.ceil(self._gathered_s / STEP_S)
        for _ in range(steps):
            day = self._core.calendar_rate(self._standing, soc, temperature_c)[:, 0]
            self._standing = self._standing + day * (self._gathered_s / steps) / 86_400.0
        self._cycling = self._cycling + cycle * self._sums[2]
        self._gathered_s, self._sums = 0.0, np.zeros_like(self._sums)
