"""Mixed-integer model predictive control: it applies the first step of the power split over the horizon."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.control.planning import Planner
from bess.control.policies.planned import PlannedPolicy
from bess.control.policies.policy import Decision, PolicyInput, SolverReport
from bess.control.policies.reactive import refuse_reactive
from bess.control.policies.settings import Settings
from bess.control.policies.simplified import simplified
from bess.system import System

if TYPE_CHECKING:
    from bess import PowerSplit


class MpcPolicy(Checkpointed):
    """Calls one compiled :class:`bess.PowerSplit` in every step with demand."""

    _carried = ("_splitter",)

    def __init__(self, splitter: PowerSplit, statuses: Mapping[int, str]) -> None:
        self._splitter = splitter
        self.statuses = statuses

    def __call__(self, inputs: PolicyInput) -> Decision:
        """Solve over the horizon; an idle step needs no solve."""
        if inputs.demand_kw[0] == 0.0:
            self._advance()
            return Decision(np.zeros_like(inputs.limit_kw), plan_kw=self._splitter.warm_start)
        split = self._splitter(
            inputs.state,
            inputs.demand_kw,
            ambient_c=inputs.ambient_c,
            limit_kw=inputs.expected_limit_kw,
        )
        report = SolverReport(
            status=split.status.code,
            gap=split.gap,
            search_gap=split.search_gap,
            nodes=split.nodes,
            solve_time_s=split.solve_time_s,
            fallback=split.fallback,
        )
        return Decision(split.request_kw[:, 0].copy(), report, plan_kw=split.request_kw)

    def skip(self, demand_kw: Array, limit_kw: Array) -> Array:
        """Pass steps without demand, see :class:`bess.control.policies.Policy`."""
        n_steps = int(np.argmax(np.append(demand_kw[:, 0], 1.0) != 0.0))
        for _ in range(n_steps):
            self._advance()
        return np.zeros_like(limit_kw[:n_steps])

    def _advance(self) -> None:
        """Shift the warm start by one step, as a solve does."""
        plan = self._splitter.warm_start
        if plan is not None:
            self._splitter.warm_start = np.pad(plan[:, 1:], ((0, 0), (0, 1)))


def build(system: System, settings: Settings) -> MpcPolicy | PlannedPolicy:
    """Return the planner or the certified power split, as selected by the settings.

    The split is compiled for the system; importing the optimiser takes 1 to 2 s. Without a limit, each step
    solves the root of its tree only: further nodes raise the bound but rarely improve the split.
    """
    chosen = settings.policy
    system = simplified(system, chosen.model)
    if chosen.plans:
        planner = Planner(system, settings.horizon_steps, settings.dt_h, rollouts=chosen.rollouts)
        return PlannedPolicy(planner, chosen.objectives, settings.terms)

    refuse_reactive(
        "a certified split",
        'let mpc plan (mode = "plan") or use a rule',
        requested=settings.reactive,
    )
    from bess import PowerSplit
    from bess.control.split.result import SplitStatus

    splitter = PowerSplit(
        system,
        settings.horizon_steps,
        objectives=chosen.objectives,
        dt_h=settings.dt_h,
        gap=chosen.gap,
        node_limit=1 if chosen.node_limit is None and chosen.time_limit_s is None else chosen.node_limit,
        time_limit_s=chosen.time_limit_s,
    )
    return MpcPolicy(splitter, {status.code: str(status) for status in SplitStatus})
