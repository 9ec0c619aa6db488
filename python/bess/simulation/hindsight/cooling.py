"""Cooling rates of a plant, identified by simulation: its nodes are linear in their temperatures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.plant import PlantEnsemble
from bess.system import State, System

_PULSE_K = 10.0


@dataclass(frozen=True)
class Cooling:
    """Bounds on the temperature excess ``theta`` of each string over a reference, as the mean of its nodes.

    Over one control step, ``theta' <= keeps theta + takes (ambient excess) + heats heat``.

    Attributes
    ----------
    keeps : ndarray, shape (n_strings,)
        Maximum remaining share of ``theta`` after a control step, for any node.
    takes : ndarray, shape (n_strings,)
        Share of the ambient's excess.
    heats : ndarray, shape (n_strings,)
        Increase of ``theta`` per heat over the step [K/kW].
    """

    keeps: Array
    takes: Array
    heats: Array

    @classmethod
    def of(cls, system: System, step_s: float) -> Cooling:
        """Identify the rates with an idle plant: warm one node at a time and simulate a step.

        Strings do not exchange heat, so each node number is tested on all strings at once.

        Raises
        ------
        InputError
            The system has a section ``[cooling]``, for which the response is not linear. Or it has heat other
            than ``R I^2``, which warms the cells and lowers the resistance below the assumed value.
        """
        if system.cooling is not None:
            raise InputError(
                f"hindsight: {system.name} has [cooling] kind = {system.cooling.kind!r}; the lower bound "
                "supports ambient-air cooling only, without that section"
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
        fleet = PlantEnsemble(system, [state] * count, ambient_c=ambient_c)
        snapshot = fleet.snapshot()
        pulses_c = np.array(snapshot.node_temperature_c)
        pulses_c[np.arange(count), :, np.arange(count)] += _PULSE_K
        fleet.restore(replace(snapshot, node_temperature_c=pulses_c))
        flows = fleet.step(np.zeros((count, system.n_strings)), step_s)
        assert flows.node_temperature_c is not None
        # left[i, m, j]: share of the excess of node i of string m that is in node j after the step.
        left = np.nan_to_num((flows.node_temperature_c - ambient_c) / _PULSE_K)
        real = np.arange(count)[:, None] < nodes
        keeps = np.where(real, left.sum(axis=2), 0.0).max(axis=0)
        takes = 1.0 - np.where(real, left.sum(axis=2), 0.0).sum(axis=0) / nodes
        heats = []
        for string in system.strings:
            thermal = string.thermal.spatial
            volume_m3 = thermal.section_m2 * thermal.length_m * thermal.packs_per_string
            heats.append(1e3 * step_s / (thermal.density_kg_m3 * thermal.specific_heat_j_kgk * volume_m3))
        # Rounding error of this simulation.
        return cls(np.minimum(keeps * (1.0 + 1e-9), 1.0), np.maximum(takes, 0.0) + 1e-9, np.array(heats))
