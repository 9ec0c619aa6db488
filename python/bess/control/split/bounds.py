"""Lower bounds of a schedule: one-step bounds, raised by relaxations if a gap remains.

Two programs are bounded (docs/algorithm.md): the nonlinear control model, rigorously, and the convexified
program, whose coefficients are frozen along the schedule. The core returns both one-step bounds with the
search. This module adds a relaxation over the whole horizon and a branch and bound over its binaries.
"""

from __future__ import annotations

import time

import numpy as np

from bess import _core
from bess.arrays import Array
from bess.control.objectives import NAMES, Costs
from bess.control.problem import SplitProblem
from bess.control.split import tree
from bess.control.split.relaxation.data import PlantConstants
from bess.control.split.relaxation.group import RelaxedGroup
from bess.control.split.result import GroupResult, relative_gap
from bess.control.split.settings import SplitSettings
from bess.control.split.tree import Termination

RELAXED_ABOVE = 3e-2
"""Rigorous gap above which a relaxation over the whole horizon complements the one-step problems."""

RELAXED_STEPS = 16
"""Longest horizon of that relaxation without availability loss. For longer horizons it closes 10 to 25 % of
the gap and takes a third of the time."""

PRICED_SIZE = 32
"""String-steps above which shadow prices raise a bound first: they are tight over long horizons, and many
strings of one kind take little more time than one. In small problems, a relaxation is tighter."""

PRICED_SAMPLE = 64
"""Maximum number of strings on which prices ascend: the time for it grows with their square. The bound at
these prices is that of all strings. It needs a dynamic program for each kind of string, and is omitted for
plants of more kinds than this."""

PRICED_S = 0.02
"""Estimated time of such a bound [s], for each step and kind of string, and for each step and ten strings of
the sample. It is omitted if less time remains."""

CUTOFF_SHARE = 0.9
"""Minimum improvement on the incumbent, as a share of the requested gap; other schedules are cut off."""

MAX_RELAXATION = 256
"""String-steps above which no relaxation is solved; bounds by prices and single steps are as tight."""


class Certificate:
    """Lower bounds of every group, with relaxations if the bounds of the core leave a gap.

    Parameters
    ----------
    constants, problem, control
        The plant, the problem and its control model.
    answer
        The schedule with the bounds of its one-step problems.
    costs
        Costs of the losses.
    settings
        Objectives, gap and node limit.
    deadline
        Value of ``time.perf_counter()`` after which no relaxation starts.

    Attributes
    ----------
    groups : tuple of GroupResult
    reasons : tuple of Termination or None
        For each group, the reason for the end of the search of the convexified program; None if the rigorous
        gap is within the requested one.
    nodes : int
        Number of solved relaxations.
    failed : bool
        Whether all relaxations of some group failed.
    incumbent : _core.Incumbent
        The schedule, or a better one from a relaxation.
    """

    def __init__(
        self,
        constants: PlantConstants,
        problem: SplitProblem,
        control: _core.ControlHorizon,
        answer: _core.SplitAnswer,
        costs: Costs,
        settings: SplitSettings,
        deadline: float | None,
    ) -> None:
        self._constants, self._problem, self._control = constants, problem, control
        self._answer, self._costs, self._settings = answer, costs, settings
        self._deadline = deadline
        self._abs_tol, _ = settings.objectives.tolerances
        self.incumbent = answer.incumbent
        self.nodes = 0
        self.failed = False
        certified = [self._certified(index) for index in range(len(answer.groups))]
        self.groups = tuple(group for group, _ in certified)
        self.reasons = tuple(reason for _, reason in certified)

    def _certified(self, index: int) -> tuple[GroupResult, Termination | None]:
        """Bound one group: rigorously, then in the convexified program."""
        group, before = self._answer.groups[index], self._answer.groups[:index]
        bound, search_bound = group.bound, group.search_bound
        ended = reason = None
        if not self._is_closed(index, group.objective, bound):
            ceilings = [earlier.ceiling for earlier in before]
            if self._wants_prices(index):
                priced = self._control.priced_bound(np.array(ceilings), group.objective, PRICED_SAMPLE)
                bound = max(bound, priced)
            if self._wants_relaxation(index, bound):
                ended = self._relaxed(ceilings, self._costs.reported, bound, group.objective)
                bound = ended.bound
        kept = self.incumbent, self.failed
        if self._is_closed(index, group.search_objective, search_bound):
            reason = Termination.GAP
        elif group.is_search_optimum:
            reason = Termination.TREE
        elif self._is_late():
            reason = Termination.TIME_LIMIT
        elif self._problem.limit_kw.size > MAX_RELAXATION:
            reason = Termination.TOO_LARGE
        else:
            ceilings = [earlier.search_ceiling for earlier in before]
            root = self._relaxed(
                ceilings, self._costs.searched, search_bound, group.search_objective, frozen=True
            )
            search_bound = root.bound
            reason = root.reason if ended is None or root.reason is Termination.GAP else ended.reason
        if self._is_closed(index, group.objective, bound):
            # The schedule is proven, whatever the convexified program gives.
            reason, (self.incumbent, self.failed) = None, kept
        objectives = self._settings.objectives
        members = objectives.groups[index]
        result = GroupResult(
            priority=objectives.members[members[0]].priority,
            members=tuple(NAMES[i] for i in members),
            objective=group.objective,
            bound=bound,
            search_bound=search_bound,
            gap=relative_gap(group.objective, bound),
            search_gap=relative_gap(group.search_objective, search_bound),
        )
        return result, reason

    def _wants_prices(self, index: int) -> bool:
        """Whether prices are likely to raise the rigorous bound in time."""
        group = self._answer.groups[index]
        n_strings, n_steps = self._problem.limit_kw.shape
        if (
            group.boxes is None
            or relative_gap(group.objective, group.bound) <= RELAXED_ABOVE
            or n_strings * n_steps <= PRICED_SIZE
        ):
            return False
        n_kinds = self._control.n_kinds()
        needed_s = PRICED_S * n_steps * (n_kinds + min(n_strings, PRICED_SAMPLE) / 10)
        return n_kinds <= PRICED_SAMPLE and not self._is_late(needed_s)

    def _wants_relaxation(self, index: int, bound: float) -> bool:
        """Whether branch and bound is requested, or a relaxation is likely to raise the rigorous bound."""
        group = self._answer.groups[index]
        n_strings, n_steps = self._problem.limit_kw.shape
        sheds = bool(self._answer.flows.availability_loss_kw.any())
        pays = relative_gap(group.objective, bound) > RELAXED_ABOVE and (n_steps <= RELAXED_STEPS or sheds)
        return (
            group.boxes is not None
            and not self._is_closed(index, group.objective, bound)
            and (pays or (self._settings.node_limit or 1) > 1)
            and n_strings * n_steps <= MAX_RELAXATION
            and not self._is_late()
        )

    def _relaxed(
        self,
        ceilings: list[float],
        cost: Array,
        start_bound: float,
        objective: float,
        *,
        frozen: bool = False,
    ) -> tree.TreeResult:
        """Branch and bound of the group that follows those with ``ceilings``, with coefficients over the
        states of each node; or only its root, with coefficients frozen along the schedule."""
        index = len(ceilings)
        boxes = self._answer.groups[index].boxes
        assert boxes is not None
        gap, abs_gap = self._settings.gap, self._abs_tol[index]
        # Schedules that improve the incumbent by less than the gap need no bound.
        cost_limit = objective - CUTOFF_SHARE * max(abs_gap, gap * abs(objective))
        relaxed = RelaxedGroup(
            self._problem,
            self._control,
            self._constants,
            cost,
            ceilings,
            objective if frozen else cost_limit,
            self._states_along(),
            self._propose,
            frozen=frozen,
        )
        ended = tree.search(
            relaxed.solve(self._control.root(boxes)),
            lambda: relaxed.nodes,
            lambda: objective,
            gap=gap,
            abs_gap=abs_gap,
            node_limit=1 if frozen else self._settings.nodes(*self._problem.limit_kw.shape),
            deadline=self._deadline,
            start_bound=start_bound,
        )
        self.nodes += ended.nodes
        self.failed = self.failed or 0 < relaxed.failures == ended.nodes
        return ended

    def _propose(self, request_pu: Array, on: Array) -> None:
        """Evaluate the point of a node, and the point with only the strings whose binary is above 0.5."""
        wanted = np.maximum(request_pu, 0.0) * self._constants.nominal_kw[:, None]
        wanted = np.stack([wanted, np.where(on > 0.5, wanted, 0.0)])
        self.incumbent = self._control.best_of(self.incumbent, wanted) or self.incumbent

    def _states_along(self) -> _core.StateBoxes:
        """States along the schedule as degenerate boxes, ``(n_strings, n_steps + 1)``."""
        state, flows = self._problem.state, self._answer.flows
        soc = np.concatenate([state.soc[:, None], flows.soc], axis=1)
        temperature_c = np.concatenate([state.temperature_c[:, None], flows.temperature_c], axis=1)
        return _core.StateBoxes(soc, soc, temperature_c, temperature_c)

    def _is_closed(self, index: int, objective: float, bound: float) -> bool:
        within = objective - bound <= self._abs_tol[index]
        return within or relative_gap(objective, bound) <= self._settings.gap

    def _is_late(self, needed_s: float = 0.0) -> bool:
        return self._deadline is not None and time.perf_counter() + needed_s >= self._deadline
