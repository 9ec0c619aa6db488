"""The planner: in each control step, it shifts the previous plan by one step and improves it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import _core
from bess.arrays import Array, ByValue, each_step, whole_number
from bess.checkpoints import Checkpointed
from bess.control.planning.forecast_error import ForecastErrorTracker
from bess.control.planning.groups import MAX_BOUNDED_KINDS, groups_of, kinds_of
from bess.control.planning.prices import PlanPrices
from bess.control.planning.proven_bound import proven_bound
from bess.control.problem import SplitProblem, check_horizon
from bess.display import as_table, few, one_line, rounded
from bess.errors import InputError
from bess.system import State, System

MIN_ROLLOUTS, ROLLOUTS_PER_STRING, MAX_ROLLOUTS = 180, 22, 352
"""Roll-outs of a call, unless given. More strings have more pairs to improve (docs/foresight.md)."""
RESTART_ROLLOUTS = 300
"""Roll-outs for each start of a restart, before the best is chosen; at most twice those of a call."""
RESTART_INTERVAL_STEPS = 96
"""Calls between restarts; a restart can escape from a local optimum of the shifted warm start."""
BOUND_STEPS = 28 * RESTART_INTERVAL_STEPS
"""Calls between lower bounds, each at a restart: a bound takes as long as several days of planning."""
PRICE_PASSES = 16
"""Iterations of the shadow prices. At rated demand the search gap is then 4 to 9 %, after forty 1 to 2 %."""
PROOF_CELLS = 160
"""SOC cells of the proven bound; 160 cells take 0.4 CPU s for a day of identical strings."""
TERMINAL_VALUE_FACTOR = 0.1
"""Value of stored charge at the end of a plan, as a share of its value at the start. A larger share
over-values stored energy, because future scarcity is uncertain."""
SOC_BALANCING_PER_H = 0.001
"""Price of SOC differences [1/h], see :class:`Planner`. Without it the SOC of the strings diverges, and a
failed string or a forecast error leaves too little power."""
FIRST_STEP_WEIGHT = 1.1
"""Weight of undelivered energy in the current step, relative to later ones. At equal weights a plan may keep
energy that it can deliver now for a later step that may not need it."""
FORECAST_ERROR_BALANCING_PER_H = 0.1
"""Increase of the price of SOC differences [1/h] at a forecast error of 1 (see
:class:`bess.control.planning.forecast_error.ForecastErrorTracker`)."""
FORECAST_ERROR_DISCOUNT_TIME_H = 5.0
"""Time constant of the discount on later undelivered energy at a forecast error of 1 [h]."""
GRID_ERROR = 1e-2
"""Maximum excess of the search bound over the cost of a plan due to the grid, as a share of the cost."""
ROUNDING = 1e-9
"""Relative difference of a cost and its bound that is due to rounding."""
MAX_STEPS = 48 * 60
"""Maximum number of steps of a plan: two days of one-minute steps."""


def rollouts_of(n_strings: int, given: int | None = None) -> int:
    """Roll-outs of a call: as given, or by default those for a plant of so many strings."""
    return min(max(MIN_ROLLOUTS, ROLLOUTS_PER_STRING * n_strings), MAX_ROLLOUTS) if given is None else given


def _valid_bound(bound: float, cost: float, error: float) -> float:
    """The bound; NaN if it exceeds the cost of a schedule by more than a share ``error`` of the cost."""
    return np.nan if bound > cost + error * abs(cost) else bound


@dataclass(frozen=True, eq=False)
class Plan(ByValue):
    """A plan with its cost in the control model.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
        Set-points [kW], signed as the demand. A string may be left with less than the minimum power of its
        inverter, which it sheds; a closed loop gives such power to other strings first.
    cost : float
        Cost of the plan [kWh or EUR, the unit of the prices].
    rule_cost : float
        Cost of the cheapest rule (equal, soc, temperature, priority, rotation); ``cost`` never exceeds it.
    unmet_kw : ndarray, shape (n_steps,)
        Demand above the power of the inverters in service [kW]; no string receives it.
    rollouts : int
        Number of roll-outs of the control model.
    bound : float
        Proven lower bound of the cost of every schedule on the control model with the coefficients of the
        start of each step (``model="start"`` of :func:`bess.rollout`), while ``cost`` has those of its
        middle. It is the larger of the dual bound and the sum of the minimum costs of single
        steps (of strings that are planned one by one). NaN if not computed, or if it is above ``cost``, which
        the difference of the two forms can cause.
    search_bound : float
        Dual bound on a grid, an estimate; the proven bound if that is higher or the plan refutes
        the estimate. NaN if not computed.
    """

    request_kw: Array
    cost: float
    rule_cost: float
    unmet_kw: Array
    rollouts: int
    bound: float = np.nan
    search_bound: float = np.nan

    @property
    def gap(self) -> float:
        """Share of the cost above :attr:`bound`, including the difference of both forms of the model."""
        return self._share_above(self.bound)

    @property
    def search_gap(self) -> float:
        """Optimality gap estimated with :attr:`search_bound`, as a share of the cost.

        The grid can raise the search bound above the cost: by up to 1 %, the gap is 0; by more, the bound is
        refuted, and the proven one takes its place; NaN without one (docs/foresight.md).
        """
        return float(np.maximum(self._share_above(self.search_bound), 0.0))

    def _share_above(self, bound: float) -> float:
        """NaN for a cost that is negative because of the credit for stored charge."""
        if self.cost > 0.0:
            return (self.cost - bound) / self.cost
        return 0.0 if self.cost == bound else np.nan

    def _facts(self) -> dict[str, str]:
        return {
            "set-points now": few(self.request_kw[:, 0], "kW"),
            "steps": str(self.request_kw.shape[1]),
            "cost": f"{rounded(self.cost, 4)}, of the cheapest rule {rounded(self.rule_cost, 4)}",
            "search gap": f"{rounded(100.0 * self.search_gap)} %",
            "gap": f"{rounded(100.0 * self.gap)} %",
        }

    __repr__ = one_line
    _repr_html_ = as_table


class Planner(Checkpointed):
    """Plans the power of every string over hours or days (docs/foresight.md).

    Each call takes the measured state and the demand forecast, and shifts the previous plan by one step. A
    local search then improves this warm start on the control model in its midpoint form. If the schedule of
    a rule costs less, it replaces the plan. Results do not depend on the clock and repeat to the last bit.

    Parameters
    ----------
    system : System
        1 to 1,000 strings, which may differ. More than 16 are planned in groups of similar strings in similar
        states, formed at each restart (:func:`bess.control.planning.groups.groups_of`).
    horizon_steps : int
        Prediction horizon [steps].
    dt_h : float
        Length of a step [h].
    rollouts : int, optional
        Effort of a call, in roll-outs of all strings over the whole plan; by default that of
        :func:`rollouts_of`.
    balance : float
        Price of SOC differences [1/h]. The cost per hour is this price x (fill of the string - fill of the
        plant)^2 x nominal energy x mean price of losses; the fill is a share of the SOC window. It applies
        when the plant will be nearly empty or full, and increases with the forecast error.
    price_passes : int
        Iterations of the shadow prices in a restart; 0: restarts have no starts from dynamic programs.
    proof_cells : int, optional
        SOC cells of the proven bound in the first call and every :data:`BOUND_STEPS` calls; the computing
        time grows with their third power. None: no bounds.
    first_step_weight : float
        Weight of undelivered energy in the current step, relative to later ones.

    Attributes
    ----------
    plan_kw : ndarray, shape (n_strings, n_steps), or None
        Set-points of the last plan, shifted by the steps passed since.

    Raises
    ------
    InputError
        A parameter out of range.
    """

    _carried = ("plan_kw", "_groups", "_start_charge", "_turn", "_forecast_error")

    def __init__(
        self,
        system: System,
        horizon_steps: int,
        dt_h: float = 0.25,
        *,
        rollouts: int | None = None,
        balance: float = SOC_BALANCING_PER_H,
        price_passes: int = PRICE_PASSES,
        proof_cells: int | None = PROOF_CELLS,
        first_step_weight: float = FIRST_STEP_WEIGHT,
    ) -> None:
        self.horizon_steps, self.dt_h = check_horizon(system, horizon_steps, dt_h, MAX_STEPS)
        self.system = system
        self.rollouts = whole_number("rollouts", rollouts_of(system.n_strings, rollouts), 0)
        self._balance = balance
        self._price_passes = int(price_passes)
        self._proof_cells = proof_cells
        self._first_step_weight = first_step_weight
        self._forecast_error = ForecastErrorTracker(system.nominal_kw, self.dt_h)
        self.plan_kw: Array | None = None
        self._groups: NDArray[np.int64] | None = None
        self._start_charge = 0.0
        self._turn = 0

    def __call__(
        self,
        state: State,
        demand_kw: ArrayLike,
        prices: PlanPrices,
        *,
        ambient_c: ArrayLike | None = None,
        limit_kw: ArrayLike | None = None,
        reactive_kvar: ArrayLike | None = None,
    ) -> Plan:
        """Plan the steps ahead.

        Parameters
        ----------
        state : State
            Measured state of every string.
        demand_kw : array_like, shape (n_steps,)
            Demand on the plant [kW], positive = discharge.
        prices : PlanPrices
            Prices of losses, wear and starts.
        ambient_c : float or array_like, shape (n_steps,), optional
            Ambient temperature [degC]; the system's by default. For a system with cooling, the temperature
            that its strings cool towards (:meth:`~bess.System.surroundings_c`).
        limit_kw : array_like, shape (n_strings,) or (n_strings, n_steps), optional
            Maximum power of each inverter, over the whole plan or in each step [kW]; 0 takes a string out of
            service.
        reactive_kvar : array_like, shape (n_steps,), optional
            Reactive power demand on the plant [kvar]. The plan includes the losses of apparent power and
            assumes the power factor of the plant for every string (docs/equations.md, R4).

        Raises
        ------
        InputError
            An argument does not fit the system or the plan; the planner is then unchanged.
        """
        if prices.losses.shape != (self.horizon_steps, 4):
            raise InputError(
                f"prices of losses have shape {prices.losses.shape}; the plan needs {(self.horizon_steps, 4)}"
            )
        problem = SplitProblem.check(
            self.system, self.horizon_steps, self.dt_h, state, demand_kw, ambient_c, limit_kw
        )
        limit = problem.limit_kw
        if reactive_kvar is not None:
            values = each_step(
                "reactive_kvar", reactive_kvar, self.horizon_steps, self.dt_h, (-np.inf, np.inf), "kvar"
            )
            reactive_kvar = values if values.any() else None
        changed = self._forecast_error.compare(np.atleast_1d(np.asarray(demand_kw, dtype=np.float64)), limit)
        last_kw, previous = self.plan_kw, self._shifted_plan()
        restart = previous is None or changed or self._turn % RESTART_INTERVAL_STEPS == 0
        groups = groups_of(self.system, state, limit) if restart else self._groups
        bounded = self._turn % BOUND_STEPS == 0 and kinds_of(self.system, state, limit) <= MAX_BOUNDED_KINDS
        loss_prices = prices.losses * self._shortfall_weights()
        try:
            plan = _core.plan(
                self.system.control_at(state),
                soc=state.soc,
                temperature_c=state.temperature_c,
                running=np.zeros(len(limit), bool) if last_kw is None else last_kw[:, 0] != 0.0,
                demand_kw=problem.demand_kw,
                ambient_c=problem.ambient_c,
                dt_h=self.dt_h,
                limit_kw=limit,
                loss_prices=loss_prices,
                wear=prices.wear,
                start_cost=prices.start,
                balance=self._imbalance_price() * float(prices.losses[:, 2:].mean()),
                end_charge=TERMINAL_VALUE_FACTOR * self._start_charge,
                previous_kw=previous,
                rollouts=self.rollouts,
                restart_rollouts=min(RESTART_ROLLOUTS, 2 * self.rollouts) if restart else 0,
                price_passes=self._price_passes,
                proof_cells=self._proof_cells if bounded else None,
                turn=self._turn,
                reactive_kvar=reactive_kvar,
                groups=groups,
            )
        except ValueError as error:
            raise InputError(f"plan: {error}") from error
        self.plan_kw, self._groups = plan.request_kw.copy(), groups
        self._start_charge = plan.start_charge
        self._turn += 1
        proven, searched = (np.nan if each is None else each for each in (plan.bound, plan.search_bound))
        if plan.search_bound is not None and groups is None:
            # Not for groups: its computing time grows with the number of strings, even if they are identical.
            proven = float(np.fmax(proven, proven_bound(problem, loss_prices.min(axis=0))))
        proven = _valid_bound(proven, plan.cost, ROUNDING)
        # The proven bound replaces a lower estimate.
        searched = float(np.fmax(_valid_bound(searched, plan.cost, GRID_ERROR), proven))
        return Plan(
            plan.request_kw,
            plan.cost,
            plan.rule_cost,
            problem.unmet_kw,
            plan.rollouts,
            proven,
            searched,
        )

    def advance(self, demand_kw: ArrayLike, request_kw: ArrayLike = 0.0) -> None:
        """Advance one step, or several with a row each: demand as in a call, set-points ``(n_strings,)``."""
        rows_kw = np.atleast_2d(np.asarray(demand_kw, dtype=np.float64))
        self._forecast_error.compare(rows_kw)
        self.plan_kw = self._shifted_plan(len(rows_kw))
        if self.plan_kw is not None:
            self.plan_kw[:, 0] = np.atleast_2d(request_kw)[-1]

    def _imbalance_price(self) -> float:
        """Price of SOC differences [kWh/Ah/h], converted from energy to charge with the mean voltage."""
        kwh_per_ah = float(self.system.nominal_energy_kwh.sum() / self.system.capacity_ah.sum())
        error = self._forecast_error.relative_error
        return (self._balance + FORECAST_ERROR_BALANCING_PER_H * error) * kwh_per_ah

    def _shortfall_weights(self) -> Array:
        """Weights of the four losses, shape (n_steps, 4)."""
        error = self._forecast_error.relative_error
        hours = np.arange(self.horizon_steps) * self.dt_h
        # One by one, as the last bit of NumPy's exponential depends on the processor.
        shortfall = np.array([math.exp(x) for x in -hours * error / FORECAST_ERROR_DISCOUNT_TIME_H])
        shortfall[0] = self._first_step_weight
        weights = np.ones((self.horizon_steps, 4))
        weights[:, :2] = shortfall[:, None]
        return weights

    def _shifted_plan(self, n_steps: int = 1) -> Array | None:
        """Shifted warm start: the last plan without its first steps, and zero power in the new last steps."""
        if (plan_kw := self.plan_kw) is None:
            return None
        return np.hstack([plan_kw[:, n_steps:], np.zeros_like(plan_kw[:, :n_steps])])
