"""Mixed-integer model predictive control: the power split over the horizon, its first step applied."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from bess.foresight import Planner
from bess.parameters import System
from bess.policies.planned import PlannedPolicy
from bess.policies.policy import Decision, Situation, SolverReport
from bess.policies.reactive import refuse_reactive
from bess.policies.settings import Settings
from bess.policies.simplified import simplified

if TYPE_CHECKING:
    from bess import PowerSplit


class MpcPolicy:
    """Calls one compiled :class:`bess.PowerSplit` in every step in which something is asked."""

    def __init__(self, splitter: PowerSplit, statuses: Mapping[int, str]) -> None:
        self._splitter = splitter
        self.statuses = statuses

    def __call__(self, situation: Situation) -> Decision:
        """Solve over the horizon; an idle step needs no solve."""
        if situation.demand_kw[0] == 0.0:
            self._skip()
            return Decision(np.zeros_like(situation.limit_kw))
        split = self._splitter(
            situation.state,
            situation.demand_kw,
            ambient_c=situation.ambient_c,
            limit_kw=situation.limit_kw,
        )
        report = SolverReport(
            status=split.status.code,
            gap=split.gap,
            search_gap=split.search_gap,
            nodes=split.nodes,
            solve_time_s=split.solve_time_s,
            fallback=split.fallback,
        )
        return Decision(split.request_kw[:, 0].copy(), report)

    def _skip(self) -> None:
        """Move the plan on by one step, as a solve would have."""
        plan = self._splitter.warm_start
        if plan is not None:
            self._splitter.warm_start = np.pad(plan[:, 1:], ((0, 0), (0, 1)))

    def memory(self) -> dict[str, Any]:
        """The plan from which the next search starts."""
        return self._splitter.memory()

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Start the next search from the plan of the checkpoint."""
        self._splitter.recall(memory)


def build(system: System, settings: Settings) -> MpcPolicy | PlannedPolicy:
    """Return the planner, or the certified power split, as the settings say.

    The split is compiled for the system; it imports the optimiser, which takes a second or two. Unless a
    limit is set, each step solves the root of its tree only: further nodes raise the bound, seldom the split.
    """
    chosen = settings.split
    system = simplified(system, settings.model)
    if settings.plans:
        planner = Planner(system, settings.horizon_steps, settings.dt_h, rollouts=settings.rollouts)
        return PlannedPolicy(planner, chosen.objectives, settings.terms)

    refuse_reactive(
        "a certified split",
        'let mpc plan (mode = "plan") or use a rule',
        asked=settings.reactive,
    )
    from bess import PowerSplit
    from bess.split.result import SplitStatus

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
