"""The power split: compiled once for a system and a horizon, called at every control step.

A call checks what it is given, searches for the best schedule, certifies it, and answers; docs/algorithm.md
tells the algorithm on one page.
"""

from __future__ import annotations

import time
from dataclasses import fields
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from bess import _core
from bess.display import as_table, one_line
from bess.errors import InputError
from bess.numbers import Array, finite_array
from bess.parameters import State, System
from bess.split.bounds import Certificate, CompiledPlant, certify
from bess.split.objectives import NAMES, Objectives
from bess.split.payoff import payoff_scale
from bess.split.problem import SplitProblem, check_horizon
from bess.split.relaxation.data import PlantConstants
from bess.split.result import GroupResult, Split, SplitStatus, relative_gap
from bess.split.rollout import Rollout
from bess.split.settings import SplitSettings
from bess.split.tree import Closure

SATURATED_KW = 1e-9
"""Availability loss above which a string counts as saturated."""

ROLLOUTS = 2000
"""Effort of one descent of the local search on the control model."""

DEFAULTS = SplitSettings()

STATUS = {
    Closure.GAP: SplitStatus.CONVEXIFIED_CLOSED,
    Closure.TREE: SplitStatus.TREE_CLOSED,
    Closure.NODE_LIMIT: SplitStatus.NODE_LIMIT,
    Closure.TIME_LIMIT: SplitStatus.TIME_LIMIT,
    Closure.INFEASIBLE: SplitStatus.SOLVER_FAILED,
}


class PowerSplit:
    """Shares the demand of the next steps between the strings of a plant.

    Objectives, priorities and the mixed-integer form are those of [1]_; inverters that may be off are
    modelled by their perspective [2]_, binaries are settled by branch and bound [3]_.

    Parameters
    ----------
    system : System
        1 to 32 strings, which may differ.
    horizon_steps : int
        1 to 96.
    objectives : Objectives, optional
        Default: availability first, then derating, inverter and battery loss with equal weights.
    dt_h : float
        Length of a step [h].
    gap, time_limit_s, node_limit
        As for :class:`bess.split.settings.SplitSettings`. No relaxation is solved for more than 400 steps of
        strings.

    Attributes
    ----------
    warm_start : ndarray or None
        Requests ``(n_strings, n_steps)`` [kW] that the next call starts from: those of the last, one step on.
        Saving and restoring it makes a closed loop resumable to the last bit.

    Raises
    ------
    InputError
        A setting outside its range.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    .. [2] Frangioni, A., Gentile, C.: Perspective cuts for a class of convex 0-1 mixed integer programs.
       Mathematical Programming 106 (2006) 225.
    .. [3] Land, A. H., Doig, A. G.: An automatic method of solving discrete programming problems.
       Econometrica 28 (1960) 497, doi:10.2307/1910129.
    """

    def __init__(
        self,
        system: System,
        horizon_steps: int,
        objectives: Objectives | None = None,
        dt_h: float = 0.25,
        gap: float = DEFAULTS.gap,
        time_limit_s: float | None = DEFAULTS.time_limit_s,
        node_limit: int = DEFAULTS.node_limit,
    ) -> None:
        check_horizon(system, horizon_steps, dt_h)
        if objectives is not None and not isinstance(objectives, Objectives):
            raise InputError(f"objectives must be bess.Objectives, not {type(objectives).__name__}")
        self.system, self.horizon_steps, self.dt_h = system, int(horizon_steps), dt_h
        self.settings = SplitSettings(
            objectives=objectives if objectives is not None else DEFAULTS.objectives,
            gap=gap,
            node_limit=node_limit,
            time_limit_s=time_limit_s,
        )
        self.objectives = self.settings.objectives
        inverter_kw, battery_kw = system.control_at(system.initial_state()).nominal_loss_kw()
        strings = [s.model_dump(exclude={"site"}) for s in system.strings]
        self._plant = CompiledPlant(
            PlantConstants.of(system, battery_kw, dt_h),
            np.array([a == b for a, b in pairwise(strings)], dtype=bool),
        )
        self._scale_per_kw = _scale(system, horizon_steps, dt_h, self.objectives, inverter_kw, battery_kw)
        self._costs = self._costs_at(self._scale_per_kw)
        self._switch_soc = np.array([s.battery.low_soc_switch for s in system.strings])[:, None]
        self._warm_start: Array | None = None

    def _facts(self) -> dict[str, str]:
        return {
            "system": self.system.name,
            "strings": str(self.system.n_strings),
            "horizon": f"{self.horizon_steps} steps of {60.0 * self.dt_h:g} min",
            "objectives": self.objectives.kind,
        }

    __repr__ = one_line
    _repr_html_ = as_table

    @property
    def warm_start(self) -> Array | None:
        """Requests that the next call starts from, see the class."""
        return self._warm_start

    @warm_start.setter
    def warm_start(self, request_kw: ArrayLike | None) -> None:
        if request_kw is None:
            self._warm_start = None
            return
        request = finite_array("warm_start", request_kw).copy()
        shape = (self.system.n_strings, self.horizon_steps)
        if request.shape != shape:
            raise InputError(f"warm_start must be of shape {shape}, not {request.shape}")
        self._warm_start = request

    def __call__(
        self,
        state: State,
        demand_kw: ArrayLike,
        ambient_c: ArrayLike | None = None,
        limit_kw: ArrayLike | None = None,
    ) -> Split:
        """Split one horizon.

        Parameters
        ----------
        state : State
            Measured state of every string.
        demand_kw : array_like, shape (n_steps,)
            Demand on the plant [kW], positive = discharge; what exceeds the limits is reported as unmet.
        ambient_c : float or array_like, shape (n_steps,), optional
            Ambient temperature [degC]; the system's by default. Of a system with cooling, what its strings
            cool towards (:meth:`~bess.System.surroundings_c`).
        limit_kw : array_like, shape (n_strings,) or (n_strings, n_steps), optional
            Largest request of each string [kW]; nominal power by default, 0 takes a string out of service.

        Raises
        ------
        InputError
            If something given does not fit the system or the horizon; nothing is done then.
        """
        started = time.perf_counter()
        problem = SplitProblem.check(
            self.system, self.horizon_steps, self.dt_h, state, demand_kw, ambient_c, limit_kw
        )
        limit_s = self.settings.time_limit_s
        deadline = None if limit_s is None else started + limit_s

        costs = self._costs
        if self.objectives.normalisation == "payoff":
            abs_tol, rel_tol = self.objectives.tolerances
            costs = self._costs_at(payoff_scale(problem, self._scale_per_kw, abs_tol[0], rel_tol[0]))
        control = problem.control(*costs, *self.objectives.tolerances)

        answer = self._search(control, self._warm_start, deadline)
        certificate = self._certify(problem, control, answer, costs, deadline)
        if certificate.incumbent is not answer.incumbent:
            answer = self._search(control, certificate.incumbent.request_kw, deadline)
            certificate = self._certify(problem, control, answer, costs, deadline)
        return self._answer(problem, answer, certificate, started)

    def _costs_at(self, scale_per_kw: Array) -> tuple[Array, Array]:
        """Costs of the losses: of what is reported, and of the search."""
        reported, searched = (self.objectives.costs(scale_per_kw, tie_break=t) for t in (False, True))
        return reported, searched

    def _search(
        self, control: _core.ControlHorizon, warm_start: Array | None, deadline: float | None
    ) -> _core.SplitAnswer:
        left_s = None if deadline is None else deadline - time.perf_counter()
        return control.split(warm_start, ROLLOUTS, left_s)

    def _certify(
        self,
        problem: SplitProblem,
        control: _core.ControlHorizon,
        answer: _core.SplitAnswer,
        costs: tuple[Array, Array],
        deadline: float | None,
    ) -> Certificate:
        return certify(self._plant, problem, control, answer, costs, self.settings, deadline)

    def _answer(
        self, problem: SplitProblem, answer: _core.SplitAnswer, certificate: Certificate, started: float
    ) -> Split:
        request = answer.incumbent.request_kw
        result = Rollout(**{field.name: getattr(answer.flows, field.name) for field in fields(Rollout)})
        soc_start = np.concatenate([problem.state.soc[:, None], result.soc[:, :-1]], axis=1)
        self._warm_start = np.concatenate([request[:, 1:], request[:, -1:]], axis=1)
        idle = not problem.demand_kw.any()
        return Split(
            request_kw=request,
            inverter_on=result.delivered_kw != 0.0,
            low_soc=soc_start < self._switch_soc,
            saturated=result.availability_loss_kw > SATURATED_KW,
            rollout=result,
            groups=self._groups(certificate),
            unmet_kw=problem.unmet_kw,
            nodes=certificate.nodes,
            solve_time_s=time.perf_counter() - started,
            status=SplitStatus.NO_DEMAND if idle else _status(certificate),
        )

    def _groups(self, certificate: Certificate) -> tuple[GroupResult, ...]:
        objectives = self.objectives
        return tuple(
            GroupResult(
                priority=objectives.members[members[0]].priority,
                members=tuple(NAMES[i] for i in members),
                objective=group.objective,
                bound=group.bound,
                search_bound=group.search_bound,
                gap=relative_gap(group.objective, group.bound),
                search_gap=relative_gap(group.search_objective, group.search_bound),
            )
            for members, group in zip(objectives.groups, certificate.groups, strict=True)
        )


def split_power(
    system: System,
    state: State,
    demand_kw: ArrayLike,
    objectives: Objectives | None = None,
    dt_h: float = 0.25,
    gap: float = DEFAULTS.gap,
    time_limit_s: float | None = DEFAULTS.time_limit_s,
) -> Split:
    """Split the demand of one horizon; its length is the number of values in ``demand_kw``.

    The power split of [1]_, for one horizon.

    See :class:`PowerSplit` for the parameters; to call it at every control step, build one of those.

    Raises
    ------
    InputError
        From a setting, or from what does not fit the system.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    """
    demand = finite_array("demand_kw", demand_kw)
    if demand.ndim != 1:
        raise InputError(f"demand_kw has shape {demand.shape}; give one value for each step")
    return PowerSplit(system, demand.size, objectives, dt_h, gap, time_limit_s)(state, demand)


def _scale(
    system: System,
    horizon_steps: int,
    dt_h: float,
    objectives: Objectives,
    inverter_kw: Array,
    battery_kw: Array,
) -> Array:
    """Normalisation of each loss [1/kW], shape ``(n_strings, 4)``: one constant for the plant, so that a kWh
    lost counts the same in whichever string it is lost."""
    shape = (system.n_strings, 4)
    if objectives.normalisation == "energy":
        return np.full(shape, dt_h)
    nominal = np.stack([system.nominal_kw, system.nominal_kw, inverter_kw, battery_kw], axis=1)
    return np.broadcast_to(1.0 / (nominal.mean(axis=0) * system.n_strings * horizon_steps), shape).copy()


def _status(certificate: Certificate) -> SplitStatus:
    """The strongest statement that holds for every group."""
    if certificate.failed:
        return SplitStatus.SOLVER_FAILED
    if all(group.is_proven for group in certificate.groups):
        return SplitStatus.OPTIMAL
    return max((STATUS[group.closure] for group in certificate.groups), key=lambda status: status.code)
