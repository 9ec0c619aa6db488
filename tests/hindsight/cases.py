"""Random plants, demands and splits to hold the bound against."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bess
from bess.control.policies import PolicyInput, Settings, build_policy

Array = NDArray[np.float64]
STEP_S = 900.0
RULES = ("equal", "priority", "soc", "temperature")


def system(random: np.random.Generator) -> bess.System:
    """A bundled plant, or the reference with changes that make every term of the bound matter."""
    kind = random.integers(0, 5)
    if kind == 0:
        return bess.System.reference(int(random.integers(1, 5)))
    if kind == 1:
        return bess.load_system("unequal-4")
    if kind == 2:
        return bess.load_system("mixed-4")
    if kind == 3:
        return bess.load_system("m5bat")
    document = copy.deepcopy(bess.System.reference(3).document)
    document["battery"]["soc_min"] = float(random.choice([0.0, 0.05, 0.2]))
    document["battery"]["soc_max"] = float(random.choice([1.0, 0.9]))
    document["battery"]["r_scale"] = float(random.uniform(0.3, 3.0))
    document["battery"]["low_soc_switch"] = float(random.choice([0.0, 0.1]))
    document["inverter"]["off_loss"] = float(random.choice([0.0, 0.004]))
    ocv = document["battery"]["ocv_v"]
    ocv["temperature_c"] = [10.0, 40.0]
    for way in ("charge", "discharge"):
        ocv[way] = [ocv[way], [volt + 0.01 for volt in ocv[way]]]
    document["string"] = [{}, {"inverter": {"nominal_kw": 60.0}}, {}]
    return bess.System(document, name="changed")


def state(random: np.random.Generator, plant: bess.System) -> bess.State:
    """Anywhere within the SOC windows, often at their ends."""
    low = np.array([string.battery.soc_min for string in plant.strings])
    high = np.array([string.battery.soc_max for string in plant.strings])
    fill = np.clip(random.uniform(-0.2, 1.2, plant.n_strings), 0.0, 1.0)
    return bess.State(low + fill * (high - low), random.uniform(-5.0, 58.0, plant.n_strings))


def demand(random: np.random.Generator, plant: bess.System, limit_kw: Array) -> Array:
    """Blocks of random length, sign and size, with pauses; never above what is in service."""
    n_steps = limit_kw.shape[0]
    values = np.zeros(n_steps)
    at = 0
    while at < n_steps:
        length = int(random.integers(1, 17))
        level = random.choice([0.0, 0.02, 0.15, 0.4, 0.8, 1.0]) * random.choice([-1.0, 1.0])
        values[at : at + length] = level * plant.nominal_kw.sum() * random.uniform(0.7, 1.0)
        at += length
    total = limit_kw.sum(axis=1)
    return np.clip(values, -total, total)


def split(random: np.random.Generator, demand_kw: Array, limit_kw: Array) -> Array:
    """Shares at random, string after string up to its limit: one alone, some, or all."""
    request = np.zeros_like(limit_kw)
    for step, asked in enumerate(np.abs(demand_kw)):
        left, order = float(asked), random.permutation(limit_kw.shape[1])
        few = random.random() < 0.5
        for position, string in enumerate(order):
            share = 1.0 if few or position == order.size - 1 else random.random()
            request[step, string] = min(limit_kw[step, string], share * left)
            left -= request[step, string]
        for string in order:
            more = min(limit_kw[step, string] - request[step, string], left)
            request[step, string] += more
            left -= more
    return request * np.sign(demand_kw)[:, None]


def lost_kwh(flows: Any) -> float:
    """Undelivered energy and losses of a schedule that went through the plant."""
    kinds = ("availability_loss_kw", "derating_loss_kw", "inverter_loss_kw", "battery_loss_kw")
    return float(sum(getattr(flows, kind).sum() for kind in kinds)) * STEP_S / 3600.0


def by_rule(name: str, plant: bess.Plant, demand_kw: Array, limit_kw: Array, ambient_c: Array) -> float:
    """Lost [kWh] under a rule in closed loop."""
    policy = build_policy(name, plant.system, Settings(dt_h=STEP_S / 3600.0))
    lost = 0.0
    for step, asked in enumerate(demand_kw):
        here = PolicyInput(plant.state, np.array([asked]), float(ambient_c[step]), limit_kw[step])
        request = policy(here).request_kw
        lost += lost_kwh(plant.step(request, STEP_S, ambient_c=float(ambient_c[step])))
    return lost
