"""Claims about the bundled rules, which the core runs over many steps in one call."""

from typing import Any

import numpy as np
import pytest

import bess
from bess.arrays import Array
from bess.control.policies import PolicyInput, Settings, build_policy
from bess.control.policies.rule import RulePolicy, Share, StepDemand, water_fill
from bess.system import System

UNEQUAL = {"system.file": "unequal-4", "demand.file": "two-cycle-48h", "demand.repeat": True, "run.days": 4.0}
STUDIES: dict[str, dict[str, Any]] = {
    "two strings": {"demand.file": "two-cycle-48h", "demand.repeat": True, "run.days": 3.0},
    "unequal strings": UNEQUAL,
    "more than there is": UNEQUAL | {"demand.scale": 3.0},
    "ageing": UNEQUAL | {"wear.model": "nmc-a-75ah", "wear.replacement_eur_kwh": 120.0},
    "twelve strings": {
        "system.n_strings": 12, "demand.file": "two-cycle-48h", "demand.scale": 4.0, "run.days": 2.0
    },
}  # fmt: skip


def equal(system: System, asked: StepDemand) -> Array:
    """Weights of one."""
    return water_fill(asked.demand_kw, np.ones(system.n_strings), asked.capability_kw)


def soc(system: System, asked: StepDemand) -> Array:
    """Stored energy or headroom."""
    window = np.array([(string.battery.soc_min, string.battery.soc_max) for string in system.strings])
    left = asked.state.soc - window[:, 0] if asked.discharge else window[:, 1] - asked.state.soc
    weights = np.maximum(left, 0.0) * system.nominal_energy_kwh * asked.state.soh_capacity
    return water_fill(asked.demand_kw, weights, asked.capability_kw)


def temperature(system: System, asked: StepDemand) -> Array:
    """Distance from full derating."""
    stop_c = np.array([string.derating.stop_c for string in system.strings])
    weights = system.nominal_kw * np.maximum(stop_c - asked.state.temperature_c, 0.0)
    return water_fill(asked.demand_kw, weights, asked.capability_kw)


def priority(system: System, asked: StepDemand) -> Array:
    """One string after the other."""
    before_kw = np.concatenate([[0.0], np.cumsum(asked.capability_kw)[:-1]])
    return np.clip(asked.demand_kw - before_kw, 0.0, asked.capability_kw)


@pytest.mark.independent
@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("rule", [equal, soc, temperature, priority], ids=lambda rule: rule.__name__)
def test_a_rule_in_the_core_gives_what_it_gives_in_python_step_by_step(study: str, rule: Share) -> None:
    values = bess.load_study("policies", STUDIES[study])
    values = values.with_values({"scenario": (), "policy.name": rule.__name__})
    core = bess.run(values, progress=False).dataset
    dt_h = core.attrs["step_h"]

    def policy(system: System) -> RulePolicy:
        return RulePolicy(system, dt_h, rule)

    from bess.simulation.inputs import prepare

    alone = bess.run(values, policy=policy(prepare(values).system), progress=False).dataset
    # Sums of eight numbers and more have another order of additions in NumPy.
    exact = len(core["string"]) < 8 if "string" in core.dims else True
    for name in core.data_vars:
        if exact:
            np.testing.assert_array_equal(core[name].values, alone[name].values, err_msg=str(name))
        else:
            np.testing.assert_allclose(core[name].values, alone[name].values, rtol=1e-9, atol=1e-9)


def test_limits_may_be_whole_numbers() -> None:
    system = bess.System.reference(2)
    policy = build_policy("equal", system, Settings(dt_h=0.25, horizon_steps=1))
    demand_kw, limit_kw = np.array([50.0]), np.array([92, 92])
    decision = policy(PolicyInput(system.initial_state(), demand_kw, np.array([25.0]), limit_kw))
    np.testing.assert_allclose(decision.request_kw, [25.0, 25.0])
