"""Upper bounds of how strings cool and heat over a control step, measured on the plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.plant import PlantEnsemble
from bess.simulation.analysis.services import unbounded
from bess.system import State, System

_PULSE_K = 10.0
"""Excess temperature of a node in the test."""


def thermal_rates(system: System, step_s: float) -> Array:
    """Identify the rates ``keeps``, ``takes`` and ``heats`` [K/kW] of each string, ``(n_strings, 3)``.

    Over one control step, ``theta' <= keeps theta + takes (ambient excess) + heats heat`` for the temperature
    excess ``theta``, the mean over the nodes of a string. An idle plant shows the rates: warm one node at a
    time and simulate a step. Strings do not exchange heat, so each node number is tested on all strings at
    once. Cooling with a control is not linear, and other heat than ``R I^2`` warms the cells and lowers the
    resistance below the assumed value; both are refused.
    """
    if reason := unbounded(system):
        raise InputError(f"hindsight: {reason}")
    nodes = np.array([string.thermal.spatial.nodes for string in system.strings])
    count = int(nodes.max())
    ambient_c = 20.0
    state = State(np.mean(system.soc_window, axis=0), np.full(system.n_strings, ambient_c))
    ensemble = PlantEnsemble(system, [state] * count, ambient_c=ambient_c)
    snapshot = ensemble.snapshot()
    pulses_c = np.array(snapshot.node_temperature_c)
    pulses_c[np.arange(count), :, np.arange(count)] += _PULSE_K
    ensemble.restore(replace(snapshot, node_temperature_c=pulses_c))
    flows = ensemble.step(np.zeros((count, system.n_strings)), step_s)
    assert flows.node_temperature_c is not None
    # left[i, m, j]: share of the excess of node i of string m that is in node j after the step.
    left = np.nan_to_num((flows.node_temperature_c - ambient_c) / _PULSE_K)
    kept = np.where(np.arange(count)[:, None] < nodes, left.sum(axis=2), 0.0)
    keeps, takes = kept.max(axis=0), 1.0 - kept.sum(axis=0) / nodes
    heats = []
    for string in system.strings:
        thermal = string.thermal.spatial
        volume_m3 = thermal.section_m2 * thermal.length_m * thermal.packs_per_string
        heats.append(1e3 * step_s / (thermal.density_kg_m3 * thermal.specific_heat_j_kgk * volume_m3))
    # Rounding error of this simulation.
    rates = np.minimum(keeps * (1.0 + 1e-9), 1.0), np.maximum(takes, 0.0) + 1e-9, heats
    return np.stack(rates, axis=1)
