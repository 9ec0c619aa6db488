"""The power split: compiled once for a system and a horizon, called at every control step."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import _core
from bess.display import as_table, one_line
from bess.errors import InputError
from bess.parameters import State, System
from bess.split.bounding import Bounding, Bounds
from bess.split.branch_and_bound import Closure
from bess.split.coefficients import PlantConstants
from bess.split.inputs import HorizonInputs, check_horizon
from bess.split.objectives import NAMES, Objectives
from bess.split.outcome import GroupResult, Split, SplitStatus, relative_gap
from bess.split.payoff import payoff_scale
from bess.split.rollout import Rollout, rollout
from bess.split.search import Limits, Model, Search, Task
from bess.split.settings import SplitSettings

Array = NDArray[np.float64]

SATURATED_KW = 1e-9
"""Availability loss above which a string counts as saturated."""

ROLLOUTS = 2000
"""Effort of the local search on the control model, for each call."""

DEFAULTS = SplitSettings()

STATUS = {
    Closure.GAP: SplitStatus.OPTIMAL,
    Closure.TREE: SplitStatus.TREE_CLOSED,
    Closure.NODE_LIMIT: SplitStatus.NODE_LIMIT,
    Closure.TIME_LIMIT: SplitStatus.TIME_LIMIT,
    Closure.INFEASIBLE: SplitStatus.SOLVER_FAILED,
}


class PowerSplit:
    """Shares the demand of the next steps between the strings of a plant (MODEL.md sections 3 and 4).

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
        inverter_kw, battery_kw = _core.ControlModel(system.core).nominal_loss_kw()
        nominal = np.stack([system.nominal_kw, system.nominal_kw, inverter_kw, battery_kw], axis=1)
        # One constant for the plant: a kWh lost counts the same in whichever string it is lost.
        whole = np.broadcast_to(nominal.mean(axis=0), nominal.shape)
        constant = 1.0 / (whole * system.n_strings * horizon_steps)
        in_kwh = np.full_like(constant, dt_h)
        self._scale_per_kw = in_kwh if self.objectives.normalisation == "energy" else constant
        self._constants = PlantConstants.of(system, battery_kw, dt_h)
        strings = [s.model_dump(exclude={"site"}) for s in system.strings]
        self._alike = np.array([a == b for a, b in pairwise(strings)], dtype=bool)
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
        shape = (self.system.n_strings, self.horizon_steps)
        request = np.array(request_kw, dtype=np.float64)
        if request.shape != shape or not np.all(np.isfinite(request)):
            raise InputError(f"warm_start must be finite and of shape {shape}, not {request.shape}")
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
            Ambient temperature [degC]; the system's by default.
        limit_kw : array_like, shape (n_strings,) or (n_strings, n_steps), optional
            Largest request of each string [kW]; nominal power by default, 0 takes a string out of service.

        Raises
        ------
        InputError
            If something given does not fit the system or the horizon; nothing is done then.
        """
        started = time.perf_counter()
        inputs = HorizonInputs.check(self.system, self.horizon_steps, state, demand_kw, ambient_c, limit_kw)
        if not inputs.demand_kw.any():
            idle = Bounds(values=(0.0,) * len(self.objectives.groups), closures=(), nodes=0, failed=False)
            return self._answer(
                inputs, np.zeros_like(inputs.limit_kw), idle, idle, SplitStatus.NO_DEMAND, started
            )

        limit_s = self.settings.time_limit_s
        deadline = None if limit_s is None else started + limit_s
        task = self._task(inputs)
        search = Search(task, Limits(self.settings.gap, self.settings.node_limit, ROLLOUTS, deadline))
        search.find_incumbent(self._warm_start)
        bounding = Bounding(search)
        rigorous, frozen = bounding.rigorous(), bounding.frozen()
        return self._answer(inputs, search.request, frozen, rigorous, _status(frozen), started, task)

    def _task(self, inputs: HorizonInputs) -> Task:
        scale = self._scale_per_kw
        if self.objectives.normalisation == "payoff":
            scale = payoff_scale(scale, lambda costs: self._horizon(inputs, costs), ROLLOUTS)
        search_costs = self.objectives.costs(scale, tie_break=True)
        true_costs = self.objectives.costs(scale, tie_break=False)
        search = Model(self._horizon(inputs, search_costs), search_costs)
        same = np.array_equal(search_costs, true_costs)
        return Task(
            constants=self._constants.at(inputs.state),
            inputs=inputs,
            search=search,
            true=search if same else Model(self._horizon(inputs, true_costs), true_costs),
            tolerances=self.objectives.tolerances,
            alike=self._alike,
            rollout=lambda request: self._rollout(inputs, request),
        )

    def _horizon(self, inputs: HorizonInputs, costs: Array) -> _core.ControlHorizon:
        abs_tol, rel_tol = self.objectives.tolerances
        if costs.shape[0] != abs_tol.size:
            abs_tol, rel_tol = np.full(costs.shape[0], abs_tol[0]), np.full(costs.shape[0], rel_tol[0])
        return _core.ControlHorizon(
            self.system.core_at(inputs.state),
            inputs.state.soc,
            inputs.state.temperature_c,
            inputs.demand_kw,
            inputs.ambient_c,
            self.dt_h,
            inputs.limit_kw,
            costs,
            abs_tol,
            rel_tol,
        )

    def _rollout(self, inputs: HorizonInputs, request: Array) -> Rollout:
        return rollout(self.system, inputs.state, request, self.dt_h, ambient_c=inputs.ambient_c)

    def _answer(
        self,
        inputs: HorizonInputs,
        request: Array,
        frozen: Bounds,
        rigorous: Bounds,
        status: SplitStatus,
        started: float,
        task: Task | None = None,
    ) -> Split:
        result = self._rollout(inputs, request)
        groups = self._groups(result, frozen, rigorous, task)
        soc_start = np.concatenate([inputs.state.soc[:, None], result.soc[:, :-1]], axis=1)
        switch = np.array([s.battery.low_soc_switch for s in self.system.strings])
        self._warm_start = np.concatenate([request[:, 1:], request[:, -1:]], axis=1)
        return Split(
            request_kw=request,
            inverter_on=result.delivered_kw != 0.0,
            low_soc=soc_start < switch[:, None],
            saturated=result.availability_loss_kw > SATURATED_KW,
            rollout=result,
            groups=groups,
            unmet_kw=inputs.unmet_kw,
            nodes=frozen.nodes + rigorous.nodes,
            solve_time_s=time.perf_counter() - started,
            status=status,
        )

    def _groups(
        self, result: Rollout, frozen: Bounds, rigorous: Bounds, task: Task | None
    ) -> tuple[GroupResult, ...]:
        losses = np.stack(
            [
                x.sum(axis=1)
                for x in (
                    result.availability_loss_kw,
                    result.derating_loss_kw,
                    result.inverter_loss_kw,
                    result.battery_loss_kw,
                )
            ],
            axis=1,
        )
        out = []
        for g, members in enumerate(self.objectives.groups):
            objective = float((task.true.costs[g] * losses).sum()) if task else 0.0
            searched = float((task.search.costs[g] * losses).sum()) if task else 0.0
            out.append(
                GroupResult(
                    priority=self.objectives.members[members[0]].priority,
                    members=tuple(NAMES[i] for i in members),
                    objective=objective,
                    bound=rigorous.values[g],
                    search_bound=frozen.values[g],
                    gap=relative_gap(objective, rigorous.values[g]),
                    search_gap=relative_gap(searched, frozen.values[g]),
                )
            )
        return tuple(out)


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

    See :class:`PowerSplit` for the parameters; to call it at every control step, build one of those.
    """
    steps = np.shape(demand_kw)
    if len(steps) != 1:
        raise InputError(f"demand_kw has shape {steps}; give one value for each step")
    return PowerSplit(system, steps[0], objectives, dt_h, gap, time_limit_s)(state, demand_kw)


def _status(frozen: Bounds) -> SplitStatus:
    """The weakest statement of all stages."""
    if frozen.failed:
        return SplitStatus.SOLVER_FAILED
    return max((STATUS[closure] for closure in frozen.closures), key=lambda status: status.code)
