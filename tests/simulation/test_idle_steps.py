"""Claims about steps without demand, which run in one call where a policy asks for nothing in them."""

from typing import Any

import numpy as np
import pytest

import bess
from bess.control.policies.mpc import MpcPolicy
from bess.control.policies.planned import PlannedPolicy

PAUSES = {"demand.file": "two-cycle-48h", "demand.repeat": True, "run.days": 0.5}


@pytest.mark.parametrize(
    ("mode", "kind", "policy"), [("plan", "energy", PlannedPolicy), ("certified", "paper", MpcPolicy)]
)
def test_idle_steps_in_one_call_change_no_bit(
    mode: str, kind: str, policy: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study("case1", PAUSES | {"policy.mode": mode, "policy.objectives.kind": kind})
    blocks: list[int] = []
    idle = policy.idle

    def counted(self: Any, demand_kw: np.ndarray) -> None:
        blocks.append(len(demand_kw))
        idle(self, demand_kw)

    monkeypatch.setattr(policy, "idle", counted)
    together = bess.run(study, progress=False).dataset
    monkeypatch.delattr(policy, "idle")
    alone = bess.run(study, progress=False).dataset
    assert max(blocks) > 1
    assert sum(blocks) == int((alone["demand_kw"] == 0.0).sum())
    for name in alone.data_vars:
        np.testing.assert_array_equal(together[name].values, alone[name].values, err_msg=str(name))
