"""The lumped thermal model of a cooled plant, identified from the plant itself.

The controller models a string as ``dT/dt = k1 h - k2 (T - T_ref)``. With ambient-air cooling, ``T_ref`` is
the ambient temperature; with a thermostat or a chiller it is between ambient and coolant temperature. One
experiment identifies all kinds of cooling: charging and discharging at several ambient temperatures, from
cold and warm initial states. ``1 / k1`` is the heat stored in a string per kelvin; the heat that the coolant
removes in a control step is regressed on the string's temperature before it and on the ambient temperature.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bess import _core
from bess.arrays import Array
from bess.system.parse import StringParameters
from bess.system.sections import Control

_AMBIENTS_C = (5.0, 20.0, 35.0)
_STARTS_C = (20.0, 35.0)
_STEPS = 288
_PERIOD = 20
_SHARE = 0.5
_MIN_RATE_PER_S = 1e-9


@dataclass(frozen=True)
class Lumped:
    """Lumped thermal model of each string, ``T_ref = ambient_gain * ambient + offset_c``."""

    k1_k_per_j: Array
    k2_per_s: Array
    ambient_gain: Array
    offset_c: Array
    error_k: Array
    """``(n_strings,)``: temperature rise per heat, cooling rate, reference temperature, and root mean square
    error per control step [K]."""

    def surroundings_c(self, ambient_c: Array) -> Array:
        """Return the reference temperature of cooling at ambient temperatures [degC], mean of strings."""
        return np.asarray(self.ambient_gain.mean() * ambient_c + self.offset_c.mean())


def identify(core: _core.System, strings: Sequence[StringParameters], control: Control) -> Lumped:
    """Identify the lumped model of each string; the experiment starts in the middle of its SOC window."""
    control_s, plant_s = control.step_s, control.plant_step_s
    soc = np.array([(string.battery.soc_min + string.battery.soc_max) / 2.0 for string in strings])
    nominal_kw = [string.inverter.nominal_kw for string in strings]
    n_nodes = max(string.thermal.spatial.nodes for string in strings)
    cases = [(ambient, start) for ambient in _AMBIENTS_C for start in _STARTS_C]
    ambient_c = np.array([ambient for ambient, _ in cases])
    start_c = np.repeat([start for _, start in cases], soc.size).reshape(len(cases), soc.size)
    state: dict[str, Any] = {
        "soc": np.tile(soc, len(cases)),
        "node_temperature_c": np.repeat(start_c.ravel(), n_nodes),
        "derating_integral_k": np.zeros(start_c.size),
        "inverter_on": np.zeros(start_c.size, dtype=np.bool_),
        "soh_capacity": np.ones(start_c.size),
        "soh_resistance": np.ones(start_c.size),
    }
    plant = _core.Plant(core, len(cases), plant_s, "table", state)
    # Charge, rest, discharge, rest: the typical load cycles of arbitrage.
    phase = (np.arange(_STEPS) % _PERIOD) / _PERIOD
    wave = np.select([phase < 0.4, phase < 0.5, phase < 0.9], [-1.0, 0.0, 1.0], 0.0)
    request_kw = _SHARE * wave[:, None, None] * np.broadcast_to(nominal_kw, start_c.shape)
    flows = plant.run(request_kw.ravel(), np.tile(ambient_c, _STEPS), control_s, False)
    heat_w = 1e3 * flows["battery_loss_kw"].reshape(_STEPS, *start_c.shape)
    removed_w = 1e3 * flows["cooling_kw"].reshape(_STEPS, *start_c.shape)
    after_c = flows["temperature_c"].reshape(_STEPS, *start_c.shape)
    before_c = np.concatenate([start_c[None], after_c[:-1]])
    rise_k = after_c - before_c
    found = []
    for m in range(soc.size):
        kept_j = control_s * (heat_w[..., m] - removed_w[..., m])
        k1 = float((kept_j * rise_k[..., m]).sum() / (kept_j**2).sum())
        k2, ambient_gain, offset_c = _regress(k1 * removed_w[..., m], before_c[..., m], ambient_c)
        reference_c = ambient_gain * ambient_c + offset_c
        predicted_k = control_s * (k1 * heat_w[..., m] - k2 * (before_c[..., m] - reference_c))
        error_k = float(np.sqrt(((predicted_k - rise_k[..., m]) ** 2).mean()))
        found.append((k1, k2, ambient_gain, offset_c, error_k))
    return Lumped(*np.array(found).T)


def _regress(cooling_k_s: Array, before_c: Array, ambient_c: Array) -> tuple[float, float, float]:
    """``cooling = k2 (before - ambient_gain ambient - offset)`` by least squares, over steps and cases."""
    ambient = np.broadcast_to(ambient_c, before_c.shape)
    matrix = np.stack([before_c.ravel(), ambient.ravel(), np.ones(before_c.size)], axis=1)
    (k2, k3, constant), *_ = np.linalg.lstsq(matrix, cooling_k_s.ravel(), rcond=None)
    if k2 < _MIN_RATE_PER_S:  # no cooling
        return 0.0, 1.0, 0.0
    return float(k2), float(-k3 / k2), float(-constant / k2)
