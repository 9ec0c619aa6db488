"""How far the strings have aged in service: an estimate that goes on from where the system file begins.

Standing counts by time at the measured state of charge and temperature, cycling by the charge moved, both at
the rates of the string's cell model (:class:`bess.control.wear.MarginalWear`). Cycles are taken as half deep:
a running service has no end at which their depths could be counted. Only capacity is estimated; resistance
stays that of the system file. Without a cell model nothing ages.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bess import _core
from bess.arrays import Array
from bess.edge.serve.persistent import Persistent
from bess.system import State, System

BLOCK_S: Final = 900.0
"""Time over which what is measured is gathered before it counts."""
DEPTH: Final = 0.5
C_RATE: Final = 0.3
LEAST: Final = 0.05
"""Capacity never falls below this share."""


class Ageing(Persistent):
    """Capacity of each string over that of the system file.

    Parameters
    ----------
    system
        The plant; its sections ``[wear]`` name the cell models.
    """

    kept = ("_standing", "_cycling", "_gathered_s", "_sums")

    def __init__(self, system: System) -> None:
        begin = system.initial_state()
        self._ages = np.array([string.wear.cell_model for string in system.strings], dtype=bool)
        self._begin = begin.soh_capacity
        self.soh_capacity: Array = begin.soh_capacity
        self.soh_resistance: Array = begin.soh_resistance
        self._energy_kwh = system.nominal_energy_kwh
        self._core = _core.Ageing(system.core)
        lost = np.maximum(1.0 - begin.soh_capacity, 0.0)
        share = np.array([string.wear.calendar_share for string in system.strings])
        self._standing, self._cycling = share * lost, (1.0 - share) * lost
        self._at_begin = self._standing + self._cycling
        self._gathered_s = 0.0
        self._sums = np.zeros((3, system.n_strings))

    def gather(self, state: State, power_kw: Array, elapsed_s: float, carried_s: float) -> None:
        """Take down what was measured over a time, of which power was carried for a part [s]."""
        if not self._ages.any():
            return
        full_cycles = np.abs(power_kw) * carried_s / 3600.0 / (2.0 * self._energy_kwh * self.soh_capacity)
        by_time = elapsed_s * np.stack([state.soc, state.temperature_c])
        self._sums = self._sums + np.vstack([by_time, full_cycles])
        self._gathered_s += elapsed_s
        if self._gathered_s >= BLOCK_S:
            self._close()

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
        super().recall(memory)
        self._update()

    def _close(self) -> None:
        soc, temperature_c = (np.ascontiguousarray(row[:, None]) for row in self._sums[:2] / self._gathered_s)
        day = self._core.calendar_rate(self._standing, soc, temperature_c)[:, 0]
        depth, c_rate = np.full_like(soc, DEPTH), np.full_like(soc, C_RATE)
        cycle = self._core.cyclic_rate(self._cycling, depth, soc, c_rate, temperature_c)[:, 0]
        self._standing = self._standing + day * self._gathered_s / 86_400.0
        self._cycling = self._cycling + cycle * self._sums[2]
        self._gathered_s, self._sums = 0.0, np.zeros_like(self._sums)
        self._update()

    def _update(self) -> None:
        lost = self._standing + self._cycling - self._at_begin
        self.soh_capacity = np.where(self._ages, np.maximum(self._begin - lost, LEAST), self._begin)
