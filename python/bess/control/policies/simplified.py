"""Simplified plant models for the controller, to measure the benefit of the detailed model."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from bess.control.rollout import rollout
from bess.convexity import convex_below
from bess.system import State, System
from bess.system.parse import StringParameters

Model = Literal["nonlinear", "convex", "linear"]

_NO_RESISTANCE = 1e-9
_REFERENCE_SOC = 0.5


def simplified(system: System, model: Model) -> System:
    """Return the system with the plant model of a controller.

    - ``nonlinear``: unchanged.
    - ``convex``: the convex envelope of the inverter loss from zero power on, without no-load loss, as in a
      relaxation without binaries. Resistance, voltage and derating are unchanged.
    - ``linear``: one constant efficiency in each direction (at nominal power, SOC 0.5 and 25 degC), constant
      voltage, no heat and no derating.

    Strings, powers, energies and SOC windows do not change.
    """
    if model == "nonlinear":
        return system
    change = _convex if model == "convex" else _linear
    tables = [change(string) for string in system.strings]
    document = {
        "system": {"n_strings": system.n_strings, "ambient_c": system.ambient_c},
        "control": system.control.model_dump(),
        "string": tables,
    }
    return System(document, name=f"{system.name}, {model} model")


def _convex(string: StringParameters) -> dict[str, Any]:
    tables = string.table()
    load = np.array(string.inverter.load)
    for key in ("loss_charge", "loss_discharge"):
        loss = np.array(tables["inverter"][key])
        loss[0] = 0.0
        tables["inverter"][key] = convex_below(load, loss).tolist()
    return tables


def _linear(string: StringParameters) -> dict[str, Any]:
    tables = string.table()
    battery, inverter = string.battery, string.inverter
    heat = _heat_share(string)
    for key in ("loss_charge", "loss_discharge"):
        slope = getattr(inverter, key)[-1] + heat
        tables["inverter"][key] = [slope * load for load in inverter.load]
    tables["inverter"]["off_loss"] = 0.0
    tables["battery"]["r_scale"] = _NO_RESISTANCE
    ocv, mean_v = battery.ocv_v, [battery.ocv_v.mean_v] * 2
    tables["battery"]["ocv_v"] = {"soc": [ocv.soc[0], ocv.soc[-1]], "charge": mean_v, "discharge": mean_v}
    for key in ("cell_voltage_min_v", "cell_voltage_max_v"):
        tables["battery"].pop(key, None)
    tables["derating"]["factor"] = [1.0] * len(string.derating.factor)
    return tables


def _heat_share(string: StringParameters) -> float:
    """Battery loss at nominal power, relative to this power."""
    alone = System({"system": {"n_strings": 1}, "string": [string.table()]}, name="one string")
    state = State([_REFERENCE_SOC], [25.0])
    roll = rollout(alone, state, [[string.inverter.nominal_kw]], 1.0 / 3600.0)
    return float(roll.battery_loss_kw[0, 0] / string.inverter.nominal_kw)
