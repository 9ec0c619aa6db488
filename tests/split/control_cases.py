"""Random systems, states and problems for the properties of the control model."""

from __future__ import annotations

import copy
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bess
from bess import _core

DT_H = 0.25
AMBIENT_C = 25.0
CORNERS = {
    "regular": ((0.42, 0.58), (25.0, 40.0)),
    "full": ((0.93, 1.0), (25.0, 40.0)),
    "empty": ((0.0, 0.09), (25.0, 40.0)),
    "hot": ((0.42, 0.58), (45.5, 54.0)),
}


_reference = functools.cache(bess.System.reference)


def _reference_document(n_strings: int) -> dict[str, Any]:
    return copy.deepcopy(_reference(n_strings).document)


def differing(n_strings: int, rng: np.random.Generator) -> bess.System:
    """Strings that differ in size, inverter, resistance, tables, SOC window and voltage limits."""
    return bess.System(_differing_document(n_strings, rng), name="differing")


def _differing_document(n_strings: int, rng: np.random.Generator) -> dict[str, Any]:
    document = _reference_document(n_strings)
    ocv = document["battery"]["ocv_v"]
    document["string"] = []
    for m in range(n_strings):
        parallel = int(rng.integers(3, 6))
        document["string"].append(
            {
                "battery": {
                    "cells_parallel": parallel,
                    "r_scale": float(rng.uniform(0.3, 1.6)),
                    "soc_min": [0.0, 0.03][m % 2],
                    "soc_max": [1.0, 0.97][m % 2],
                    **([{}, {"cell_voltage_min_v": 3.35, "cell_voltage_max_v": 4.09}][m % 2]),
                    "ocv_v": {
                        "soc": ocv["soc"],
                        "temperature_c": [0.0, 50.0],
                        "charge": [ocv["charge"], [v + 0.01 for v in ocv["charge"]]],
                        "discharge": [ocv["discharge"], [v + 0.01 for v in ocv["discharge"]]],
                    },
                },
                "inverter": {
                    "nominal_kw": float(rng.uniform(60.0, 110.0)),
                    # Not convex, to see that nothing relies on it.
                    "load": [0.0, 0.1, 0.3, 0.6, 1.0],
                    "loss_charge": [0.006, 0.012, 0.011, 0.019, 0.022],
                    "loss_discharge": [0.005, 0.011, 0.010, 0.016, 0.024],
                },
            }
        )
    return document


@dataclass(frozen=True)
class Case:
    """A split problem and its compiled control model."""

    system: bess.System
    state: bess.State
    demand_kw: NDArray[np.float64]
    limit_kw: NDArray[np.float64]
    costs: NDArray[np.float64]
    horizon: Any

    @property
    def sign(self) -> NDArray[np.float64]:
        return np.where(self.demand_kw < 0.0, -1.0, 1.0)

    def random_requests(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Feasible schedules ``(n, n_strings, n_steps)``: random order and shares, some strings off, none
        below its least power."""
        n_strings, n_steps = self.limit_kw.shape
        out = np.zeros((n, n_strings, n_steps))
        limits = self.limit_kw.T.tolist()
        for b in range(n):
            for t, limit in enumerate(limits):
                left, order = abs(float(self.demand_kw[t])), rng.permutation(n_strings).tolist()
                for place, m in enumerate(order):
                    rest = sum(limit[other] for other in order[place + 1 :])
                    low, high = max(0.0, left - rest), min(left, limit[m])
                    share = (0.0, 1.0, rng.random())[rng.integers(3)]
                    out[b, m, t] = power = low + share * max(high - low, 0.0)
                    left -= power
        return self.set_points(out * self.sign)

    def set_points(self, requests: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same schedules with no request below the least power."""
        control = self.system.control_at(self.state)
        out = np.abs(requests)
        for schedule in out:
            for t, limit in enumerate(self.limit_kw.T):
                schedule[:, t] = control.set_points(schedule[:, t].copy(), limit.copy())
        return out * self.sign

    def cost_by_group(self, roll: bess.Rollout, parts: slice) -> NDArray[np.float64]:
        """Costs ``(..., G, T)`` of some kinds of loss, summed over strings."""
        losses = np.stack(
            [
                roll.availability_loss_kw,
                roll.derating_loss_kw,
                roll.inverter_loss_kw,
                roll.battery_loss_kw,
            ]
        )
        return np.einsum("gml,l...mt->...gt", self.costs[..., parts], losses[parts])


def box(
    soc_low: NDArray[np.float64],
    soc_high: NDArray[np.float64],
    cool: NDArray[np.float64],
    warm: NDArray[np.float64],
) -> _core.StateBoxes:
    """Boxes of states from arrays that may be views."""
    return _core.StateBoxes(*(np.ascontiguousarray(a) for a in (soc_low, soc_high, cool, warm)))


def points(soc: NDArray[np.float64], temperature_c: NDArray[np.float64]) -> _core.StateBoxes:
    """Boxes that are points."""
    return box(soc, soc, temperature_c, temperature_c)


def case(
    seed: int,
    corner: str,
    n_strings: int = 2,
    n_steps: int = 4,
    weights: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0),
    like: bool = False,
    load: tuple[float, float] = (0.05, 1.0),
    turns: bool = False,
    min_power_kw: float = 1e-3,
) -> Case:
    """A problem with one direction, or one whose direction ``turns`` at random."""
    rng = np.random.default_rng(seed)
    document = _reference_document(n_strings) if like else _differing_document(n_strings, rng)
    document["inverter"]["min_power_kw"] = min_power_kw
    system = bess.System(document, name="like" if like else "differing")
    (soc_low, soc_high), temperature = CORNERS[corner]
    low = np.array([s.battery.soc_min for s in system.strings])
    high = np.array([s.battery.soc_max for s in system.strings])
    soc = np.clip(rng.uniform(soc_low, soc_high, n_strings), low, high)
    state = bess.State(soc, rng.uniform(*temperature, n_strings))
    sign = {"full": -1.0, "empty": 1.0}.get(corner, rng.choice([-1.0, 1.0]))
    demand = sign * rng.uniform(*load, n_steps) * system.nominal_kw.sum()
    if turns:
        demand *= rng.choice([-1.0, 1.0], n_steps)
    limit = np.repeat(system.nominal_kw[:, None], n_steps, axis=1)
    inverter_kw, battery_kw = _core.ControlModel(system.core).nominal_loss_kw()
    scale = 1.0 / np.stack([system.nominal_kw, system.nominal_kw, inverter_kw, battery_kw], axis=1)
    scale /= n_strings * n_steps
    first = np.array([weights[0], 0.0, 0.0, 0.0])
    costs = np.stack([scale * first, scale * (np.array(weights) - first)])
    horizon = _core.ControlHorizon(
        _core.ControlModel(system.core),
        state.soc,
        state.temperature_c,
        demand,
        np.full(n_steps, AMBIENT_C),
        DT_H,
        limit,
        costs,
        costs,
        np.array([1e-7, 1e-7]),
        np.array([1e-6, 1e-6]),
    )
    return Case(system, state, demand, limit, costs, horizon)


def sheds(system: bess.System, roll: bess.Rollout) -> NDArray[np.bool_]:
    """Whether something is shed; not less than the least power, which any string may that derates."""
    shed_kw, idle = roll.availability_loss_kw, roll.delivered_kw == 0.0
    return (shed_kw > 0.0) & ~(idle & (shed_kw < system.min_power_kw[:, None]))
