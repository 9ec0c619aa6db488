"""The power split: compiled once for a system and a horizon, called at every control step.

A call checks its arguments, searches for the best schedule and certifies it; docs/algorithm.md describes the
algorithm.
"""

from __future__ import annotations

import time
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from bess import _core
from bess.arrays import Array, finite_array, read_only
from bess.checkpoints import Checkpointed
from bess.control.objectives import Objectives
from bess.control.problem import SplitProblem, check_horizon, demand_of_steps
from bess.control.rollout import Rollout
from bess.control.split.bounds import Certificate
from bess.control.split.normalisation import constant_scale, payoff_scale
from bess.control.split.relaxation.data import PlantConstants
from bess.control.split.result import Split, SplitStatus
from bess.control.split.settings import ROLLOUTS, SplitSettings
from bess.control.split.warm_start import WarmStart
from bess.display import as_table, one_line
from bess.errors import InputError
from bess.system import State, System

SATURATED_KW = 1e-9
"""Availability loss above which a string counts as saturated."""

MAX_SEARCHES = 2
"""Maximum searches of a call: a better schedule from a relaxation is improved by one further search."""

DEFAULTS = SplitSettings()


class PowerSplit(Checkpointed):
    """Allocates the demand of the next steps to the strings of a plant.

    Objectives, priorities and the mixed-integer form follow [1]_. The perspective formulation [2]_ models
    inverters that may be off, and branch and bound [3]_ fixes the binaries.

    Parameters
    ----------
    system : System
        Strings may differ.
    horizon_steps : int
        1 to 96.
    objectives : Objectives, optional
        Default: availability first, then derating, inverter and battery loss with equal weights.
    dt_h : float
        Length of a step [h].
    gap, time_limit_s, node_limit
        As for :class:`bess.control.split.settings.SplitSettings`. Relaxations are solved for at most 256
        string-steps (strings x steps); above that, the bound comes from single steps or shadow prices.

    Attributes
    ----------
    warm_start : ndarray or None
        Shifted requests of the last call, ``(n_strings, n_steps)`` [kW], read-only, from which the next call
        starts. A call ignores them if its demand, limits or state differ from those of the last call's
        forecast. :meth:`state_dict` and :meth:`load_state_dict` make a closed loop resumable to the last bit.

    Raises
    ------
    InputError
        A setting outside its range, or objectives of kind ``money``, which need plans and prices.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    .. [2] Frangioni, A., Gentile, C.: Perspective cuts for a class of convex 0-1 mixed integer programs.
       Mathematical Programming 106 (2006) 225.
    .. [3] Land, A. H., Doig, A. G.: An automatic method of solving discrete programming problems.
       Econometrica 28 (1960) 497, doi:10.2307/1910129.
    """

    _carried = ("_warm_start",)
    _classes: ClassVar = {"_warm_start": WarmStart}

    def __init__(
        self,
        system: System,
        horizon_steps: int,
        objectives: Objectives | None = None,
        dt_h: float = 0.25,
        gap: float = DEFAULTS.gap,
        time_limit_s: float | None = DEFAULTS.time_limit_s,
        node_limit: int | None = DEFAULTS.node_limit,
    ) -> None:
        self.horizon_steps, self.dt_h = check_horizon(system, horizon_steps, dt_h)
        if objectives is not None and not isinstance(objectives, Objectives):
            raise InputError(f"objectives must be bess.Objectives, not {type(objectives).__name__}")
        self.system = system
        self.settings = SplitSettings(
            objectives=objectives if objectives is not None else DEFAULTS.objectives,
            gap=gap,
            node_limit=node_limit,
            time_limit_s=time_limit_s,
        )
        self.objectives = self.settings.objectives
        if self.objectives.kind == "money":
            raise InputError(
                'objectives of kind "money" need plans and prices; use "energy" or "paper" for a split'
            )
        self._constants = PlantConstants.of(system, self.dt_h)
        self._scale_per_kw = constant_scale(system, self.horizon_steps, self.dt_h, self.objectives)
        self._costs = self.objectives.costs(self._scale_per_kw)
        self._switch_soc = np.array([s.battery.low_soc_switch for s in system.strings])[:, None]
        self._warm_start: WarmStart | None = None

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
        """Requests from which the next call starts, see the class."""
        return None if self._warm_start is None else read_only(self._warm_start.request_kw)

    @warm_start.setter
    def warm_start(self, request_kw: ArrayLike | None) -> None:
        if request_kw is None:
            self._warm_start = None
            return
        request = finite_array("warm_start", request_kw).copy()
        shape = (self.system.n_strings, self.horizon_steps)
        if request.shape != shape:
            raise InputError(f"warm_start must be of shape {shape}, not {request.shape}")
        self._warm_start = WarmStart(request)

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
            Demand on the plant [kW], positive = discharge; demand above the limits is reported as unmet.
            Times of pandas and xarray data must be ``dt_h`` apart.
        ambient_c : float or array_like, shape (n_steps,), optional
            Ambient temperature [degC]; the system's by default. For a system with cooling, the temperature
            that its strings cool towards (:meth:`~bess.System.surroundings_c`).
        limit_kw : array_like, shape (n_strings,) or (n_strings, n_steps), optional
            Maximum request of each string [kW]; nominal power by default, 0 takes a string out of service.

        Raises
        ------
        InputError
            An argument does not fit the system or the horizon; the split is then unchanged.
        """
        started = time.perf_counter()
        problem = SplitProblem.check(
            self.system, self.horizon_steps, self.dt_h, state, demand_kw, ambient_c, limit_kw
        )
        limit_s = self.settings.time_limit_s
        deadline = None if limit_s is None else started + limit_s

        costs = self._costs
        if self.objectives.normalisation == "payoff":
            costs = self.objectives.costs(payoff_scale(problem, self._scale_per_kw, self.objectives))
        control = problem.control(costs, *self.objectives.tolerances)

        warm_start = self._warm_start
        start = warm_start.request_kw if warm_start is not None and warm_start.is_valid_for(problem) else None
        for _ in range(MAX_SEARCHES):
            left_s = None if deadline is None else deadline - time.perf_counter()
            answer = control.split(start, ROLLOUTS, left_s, self.settings.gap)
            certificate = Certificate(
                self._constants, problem, control, answer, costs, self.settings, deadline
            )
            if certificate.incumbent is answer.incumbent:
                break
            # A relaxation gave a better schedule: continue the search from it.
            start = certificate.incumbent.request_kw
        return self._answer(problem, answer, certificate, started)

    def _answer(
        self, problem: SplitProblem, answer: _core.SplitAnswer, certificate: Certificate, started: float
    ) -> Split:
        request = answer.incumbent.request_kw
        result = Rollout.of(answer.flows)
        soc_start = np.concatenate([problem.state.soc[:, None], result.soc[:, :-1]], axis=1)
        self._warm_start = WarmStart.after(problem, request, result)
        idle = not problem.demand_kw.any()
        return Split(
            request_kw=request,
            inverter_on=result.delivered_kw != 0.0,
            low_soc=soc_start < self._switch_soc,
            saturated=result.availability_loss_kw > SATURATED_KW,
            rollout=result,
            groups=certificate.groups,
            unmet_kw=problem.unmet_kw,
            nodes=certificate.nodes,
            solve_time_s=time.perf_counter() - started,
            status=SplitStatus.NO_DEMAND if idle else _status(certificate),
        )


def split_power(
    system: System,
    state: State,
    demand_kw: ArrayLike,
    objectives: Objectives | None = None,
    dt_h: float = 0.25,
    gap: float = DEFAULTS.gap,
    time_limit_s: float | None = DEFAULTS.time_limit_s,
    node_limit: int | None = DEFAULTS.node_limit,
    *,
    ambient_c: ArrayLike | None = None,
    limit_kw: ArrayLike | None = None,
) -> Split:
    """Split the demand of one horizon [1]_; its length is the number of values in ``demand_kw``.

    See :class:`PowerSplit` and its call for the parameters. For repeated calls, build one once.

    Raises
    ------
    InputError
        A setting is out of range, or an argument does not fit the system.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    """
    n_steps = demand_of_steps(demand_kw).size
    splitter = PowerSplit(system, n_steps, objectives, dt_h, gap, time_limit_s, node_limit)
    return splitter(state, demand_kw, ambient_c, limit_kw)


def _status(certificate: Certificate) -> SplitStatus:
    """Return the strongest status that holds for every group; statuses are ordered by strength."""
    if certificate.failed:
        return SplitStatus.SOLVER_FAILED
    statuses = [reason.value for reason in certificate.reasons if reason is not None]
    return max(statuses, key=list(SplitStatus).index, default=SplitStatus.OPTIMAL)
