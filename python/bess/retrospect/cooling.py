"""How fast a plant cools, asked of the plant itself: its nodes are linear in their temperatures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bess.errors import InputError
from bess.numbers import Array
from bess.parameters import State, System
from bess.plant import Fleet

_PULSE_K = 10.0


@dataclass(frozen=True)
class Cooling:
    """Bounds on the warmth of each string, the mean over its nodes of what they are above some temperature.

    Over one control step ``theta' <= keeps theta + takes (ambient above that temperature) + heats heat``.

    Attributes
    ----------
    keeps : ndarray, shape (n_strings,)
        Largest share of warmth that is left after a control step, wherever it sat.
    takes : ndarray, shape (n_strings,)
        Share of the ambient's.
    heats : ndarray, shape (n_strings,)
        Warmth for each kilowatt of heat over the step [K/kW].
    """

    keeps: Array
    takes: Array
    heats: Array

    @classmethod
    def of(cls, system: System, step_s: float) -> Cooling:
        """Ask an idle plant: warm one node after the other and look where it is after a step.

        Strings exchange no heat, so each node number is tried on all strings at once.

        Raises
        ------
        InputError
            If the system has a section ``[cooling]``, with which warmth is not linear, or heat other than
            ``R I^2``, which warms, and so lessens resistance, beyond what is counted here.
        """
        if system.cooling is not None:
            raise InputError(
                f"hindsight: {system.name} has [cooling] kind = {system.cooling.kind!r}; what is proven "
                "impossible is known for air of the ambient only, without that section"
            )
        if any(string.battery.entropy or string.battery.hysteresis_heat for string in system.strings):
            raise InputError(
                f"hindsight: {system.name} has battery.entropy or battery.hysteresis_heat; the lower bound "
                "supports ohmic heat only"
            )
        nodes = np.array([string.thermal.spatial.nodes for string in system.strings])
        count = int(nodes.max())
        middle = [0.5 * (s.battery.soc_min + s.battery.soc_max) for s in system.strings]
        ambient_c = 20.0
        state = State(middle, np.full(system.n_strings, ambient_c))
        fleet = Fleet(system, [state] * count, ambient_c=ambient_c)
        snapshot = fleet.snapshot()
        pulses_c = np.array(snapshot.node_temperature_c)
        pulses_c[np.arange(count), :, np.arange(count)] += _PULSE_K
        fleet.restore(replace(snapshot, node_temperature_c=pulses_c))
        flows = fleet.step(np.zeros((count, system.n_strings)), step_s)
        assert flows.node_temperature_c is not None
        # left[i, m, j]: of warmth in node i of string m, what is in node j after the step.
        left = np.nan_to_num((flows.node_temperature_c - ambient_c) / _PULSE_K)
        real = np.arange(count)[:, None] < nodes
        keeps = np.where(real, left.sum(axis=2), 0.0).max(axis=0)
        takes = 1.0 - np.where(real, left.sum(axis=2), 0.0).sum(axis=0) / nodes
        heats = []
        for string in system.strings:
            thermal = string.thermal.spatial
            volume_m3 = thermal.section_m2 * thermal.length_m * thermal.packs_per_string
            heats.append(1e3 * step_s / (thermal.density_kg_m3 * thermal.specific_heat_j_kgk * volume_m3))
        # Rounding of the experiment itself.
        return cls(np.minimum(keeps * (1.0 + 1e-9), 1.0), np.maximum(takes, 0.0) + 1e-9, np.array(heats))
