"""Controllers and measurements for the tests of the service."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import bess
from bess.control.objectives import Objectives
from bess.control.policies import PolicySection, Settings, build_policy
from bess.edge.plant_io import Measurements
from bess.edge.serve.controller import Controller
from bess.study.sections import ServiceSection

PLAN_STEPS = 8
_AGES = itertools.count()


def controller(
    n_strings: int = 2, system: bess.System | None = None, policy: str = "mpc", **service: Any
) -> Controller:
    """A controller that plans two hours ahead, in the thread of the caller."""
    plant = bess.System.reference(n_strings) if system is None else system
    plan = PolicySection(mode="plan", objectives=Objectives.energy())
    settings = Settings(0.25, PLAN_STEPS, plan)
    chosen = build_policy(policy, plant, settings)
    return Controller(plant, chosen, ServiceSection(**service), PLAN_STEPS, background=False)


def measured(soc: ArrayLike, temperature_c: ArrayLike = 25.0, **others: Any) -> Measurements:
    """Measurements of strings in service without limits of their own, each newer than the one before."""
    states = np.array(soc, dtype=np.float64)
    n = states.size
    values = {
        "power_kw": np.full(n, np.nan),
        "charge_limit_kw": np.full(n, np.inf),
        "discharge_limit_kw": np.full(n, np.inf),
        "available": np.ones(n, dtype=bool),
    } | {name: np.array(value) for name, value in others.items()}
    time = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=next(_AGES))
    return Measurements(
        time=time, soc=states, temperature_c=np.broadcast_to(np.array(temperature_c, float), n), **values
    )
