"""Stored energy and energy capacity of a plant, measured at the inverters."""

import numpy as np

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.dispatch.aggregate import StringEnergy, counted
from bess.system import State, System

_LEVELS = np.linspace(0.0, 1.0, 201)
"""States of charge at which the stored energy is tabulated."""


class StorageEstimator(Checkpointed):
    """Energy of all strings between two states of charge.

    With ``limit_kw``, the power of each inverter in service, only strings above 0 count, or all if none is.

    Parameters
    ----------
    system : System
        The plant.
    efficiency : float
        Round-trip efficiency, AC to AC; each direction has its square root. It is the initial value if
        measured energy updates the estimate (:meth:`update`).
    """

    _carried = ("_charged_kwh", "_discharged_kwh", "_increase_kwh", "_stored_kwh")

    def __init__(self, system: System, efficiency: float):
        self._soc_min, self._soc_max = system.soc_window
        fresh = State(np.full(system.n_strings, 0.5), np.full(system.n_strings, 25.0))
        self._energy = StringEnergy(system, fresh.soh_capacity)
        self._level_kwh = self._energy.kwh(np.tile(_LEVELS, (system.n_strings, 1)))
        # As if one full charge had been measured before.
        self._charged_kwh = self.capacity_kwh(fresh)
        self._discharged_kwh = efficiency * self._charged_kwh
        self._increase_kwh = 0.0
        self._stored_kwh: float | None = None

    @property
    def one_way_efficiency(self) -> float:
        r"""Efficiency of each direction.

        With energies :math:`C` charged and :math:`D` discharged (AC) and an increase :math:`H` of the stored
        energy, the :math:`\eta` for which :math:`\eta C - D / \eta = H`.
        """
        charged, stored = self._charged_kwh, self._increase_kwh
        return (stored + float(np.sqrt(stored**2 + 4.0 * charged * self._discharged_kwh))) / (2.0 * charged)

    def update(self, state: State, delivered_kwh: float) -> None:
        """Update the efficiency with the step that led to ``state``.

        Parameters
        ----------
        state : State
            Measured now.
        delivered_kwh : float
            AC energy of the step, positive = discharge; 0 at first.
        """
        stored_kwh = self.stored_kwh(state)
        if self._stored_kwh is not None:
            self._increase_kwh += stored_kwh - self._stored_kwh
        self._stored_kwh = stored_kwh
        self._charged_kwh += max(0.0, -delivered_kwh)
        self._discharged_kwh += max(0.0, delivered_kwh)

    def stored_kwh(self, state: State, limit_kw: Array | float = np.inf) -> float:
        """Energy stored above the lower SOC limits."""
        return float((self._energy.kwh(state.soc) * _counted_soh(state, limit_kw)).sum())

    def capacity_kwh(self, state: State, soc_max: float = 1.0, limit_kw: Array | float = np.inf) -> float:
        """Energy capacity: every string at ``soc_max``, or at its own limit if that is lower."""
        full = self._energy.kwh(np.minimum(self._soc_max, np.maximum(soc_max, self._soc_min)))
        return float((full * _counted_soh(state, limit_kw)).sum())

    def soc_at(self, state: State, stored_kwh: float, limit_kw: Array | float = np.inf) -> float:
        """Return the common SOC of all strings at a total stored energy."""
        return float(np.interp(stored_kwh, _counted_soh(state, limit_kw) @ self._level_kwh, _LEVELS))


def _counted_soh(state: State, limit_kw: Array | float) -> Array:
    """Capacities relative to new strings; 0 for those that do not count."""
    return np.where(counted(np.asarray(limit_kw)), state.soh_capacity, 0.0)
