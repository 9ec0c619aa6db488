"""Claims about steps that leave no choice, which run in one call where a policy skips them."""

from typing import Any

import numpy as np
import pytest

import bess
from bess.control.planning import Planner
from bess.control.policies import NO_OPTIMISATION, PolicyInput
from bess.control.policies.mpc import MpcPolicy
from bess.control.policies.planned import PlannedPolicy
from bess.simulation.closed_loop import ClosedLoop
from bess.system.terms import SettlementTerms

PAUSES = {"demand.file": "two-cycle-48h", "demand.repeat": True, "run.days": 0.5}
FULL_POWER = 184.0 / 78.0
"""Scale at which the high level of the profile is the power of both inverters."""


@pytest.mark.parametrize(
    ("mode", "kind", "scale", "policy"),
    [
        ("plan", "energy", 1.0, PlannedPolicy),
        ("plan", "energy", FULL_POWER, PlannedPolicy),
        ("certified", "paper", 1.0, MpcPolicy),
    ],
)
def test_skipped_steps_in_one_call_change_no_bit(
    mode: str, kind: str, scale: float, policy: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study(
        "case1", PAUSES | {"policy.mode": mode, "policy.objectives.kind": kind, "demand.scale": scale}
    )
    blocks: list[int] = []
    skip = policy.skip

    def counted(self: Any, demand_kw: np.ndarray, limit_kw: np.ndarray) -> np.ndarray:
        skipped_kw: np.ndarray = skip(self, demand_kw, limit_kw)
        blocks.append(len(skipped_kw))
        return skipped_kw

    monkeypatch.setattr(policy, "skip", counted)
    together = bess.run(study, progress=False).dataset
    monkeypatch.setattr(policy, "skip", skip)
    monkeypatch.setattr(ClosedLoop, "in_blocks", False)
    alone = bess.run(study, progress=False).dataset
    demand_kw = np.abs(alone["demand_kw"].values)
    assert max(blocks) > 1
    assert sum(blocks) == int(((demand_kw == 0.0) | (demand_kw > 184.0 - 1e-6)).sum())
    for name in alone.data_vars:
        np.testing.assert_array_equal(together[name].values, alone[name].values, err_msg=str(name))


def test_a_demand_of_all_power_is_shared_without_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Planner, "__call__", lambda *_, **__: pytest.fail("a plan was made"))
    system = bess.System.reference(3)
    policy = PlannedPolicy(Planner(system, 4), bess.Objectives.energy(), SettlementTerms())
    limit_kw = np.array([46.0, 92.0, 0.0])
    for demand_kw in (138.0, -138.0, 138.0 * (1.0 - 1e-12), 0.0):
        inputs = PolicyInput(system.initial_state(), np.full(4, demand_kw), np.full(4, 25.0), limit_kw)
        decision = policy(inputs)
        np.testing.assert_allclose(decision.request_kw, limit_kw * demand_kw / 138.0, rtol=1e-15)
        assert decision.solver.status == NO_OPTIMISATION
