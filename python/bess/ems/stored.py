"""What a plant holds and has room for, as energy at the inverters."""

import numpy as np

from bess.ems.aggregate import energy_tables
from bess.ems.forecast import Array
from bess.parameters import State, System


class Store:
    """Energy of all strings between two states of charge.

    Parameters
    ----------
    system : System
        The plant.
    efficiency : float
        Round trip, AC to AC; each way has its root.
    """

    def __init__(self, system: System, efficiency: float):
        self.one_way = float(np.sqrt(efficiency))
        self._soc_min = np.array([string.battery.soc_min for string in system.strings])
        self._soc_max = np.array([string.battery.soc_max for string in system.strings])
        fresh = State(np.full(system.n_strings, 0.5), np.full(system.n_strings, 25.0))
        self._soc, self._energy = energy_tables(system, fresh, self._soc_min)

    def held_kwh(self, state: State) -> float:
        """Energy stored above the lower SOC limits."""
        return float((self._at(state.soc) * state.soh_capacity).sum())

    def size_kwh(self, state: State, soc_max: float = 1.0) -> float:
        """Energy stored when every string is at ``soc_max``, or at its own limit if that is lower."""
        full = self._at(np.minimum(self._soc_max, np.maximum(soc_max, self._soc_min)))
        return float((full * state.soh_capacity).sum())

    def soc_at(self, state: State, held_kwh: float) -> float:
        """SOC of a plant whose strings are alike in it and hold this much together."""
        levels = np.linspace(0.0, 1.0, 201)
        held = [(self._at(np.full_like(self._soc_min, soc)) * state.soh_capacity).sum() for soc in levels]
        return float(np.interp(held_kwh, held, levels))

    def _at(self, soc: Array) -> Array:
        return np.array(
            [
                np.interp(each, grid, energy)
                for each, grid, energy in zip(soc, self._soc, self._energy, strict=True)
            ]
        )
