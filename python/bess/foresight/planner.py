"""The planner: in each control step, the plan of the step before is moved on and improved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import _core
from bess.errors import InputError
from bess.foresight.mistrust import Mistrust
from bess.foresight.prices import PlanPrices
from bess.foresight.proven_bound import proven_bound
from bess.numbers import Array, ByValue, real_numbers
from bess.parameters import State, System
from bess.split.problem import SplitProblem, check_horizon

ROLLOUTS = 90
"""Roll-outs of a call. Over eight weeks of two reference strings, 40 cost 0.3 % more and 300 0.2 % less."""
FRESH_ROLLOUTS = 600
"""Most roll-outs for every rule's schedule where a plan is made from nothing, or anew; four times those of a
call if that is less."""
FRESH_STEPS = 96
"""Calls after which the plan is also made anew: what a carried plan cannot get out of, a fresh one may."""
BOUND_STEPS = 28 * FRESH_STEPS
"""Calls after which a plan that is made anew is also bounded: a bound takes as long as planning for days."""
BOUND_PASSES = 20
"""Passes of the bound by prices. A hundred raise it by 1 % of the cost."""
PROOF_CELLS = 160
"""Cells of SOC in which the bound is proven, in 0.4 CPU s for a day of strings that are alike."""
END_SHARE = 0.1
"""Value of charge at the end of a plan, as a share of its value at the start. A plan that counts on more of
it hoards: what is scarce now will be scarce again, but not certainly."""
BALANCE_PER_H = 0.01
"""Price of imbalance [1/h], see :class:`Planner`. Strings that nothing holds together drift apart; then one
that fails, or a forecast that is wrong, leaves too little power."""
DOUBT_H = 300.0
"""Time in which the price of a shortfall falls to 1/e: what is far ahead may come otherwise."""
URGENCY = 1.1
"""Price of a shortfall in the step that begins, against one just after it: what can be delivered now is not
kept for later without a gain."""
MISTRUSTED_BALANCE_PER_H = 0.1
"""What is added to the price of imbalance [1/h] where nothing that was foreseen came (mistrust 1, see
:class:`bess.foresight.mistrust.Mistrust`)."""
MISTRUSTED_DOUBT_H = 5.0
"""Time in which the price of a shortfall falls to 1/e under a mistrust of 1."""
MISTRUSTED_URGENCY = 1.0
"""What a mistrust of 1 adds to the urgency."""
MOST_STEPS = 48 * 60
"""Steps of the longest plan: two days of minutes."""


@dataclass(frozen=True, eq=False)
class Plan(ByValue):
    """A plan in the control model.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
        Set-points [kW], signed as the demand.
    cost : float
        What it costs in the control model [kWh or EUR, as its prices].
    rule_cost : float
        What the cheapest rule (equal, soc, temperature, priority, rotation) costs in the control model;
        ``cost`` is never above it.
    unmet_kw : ndarray, shape (n_steps,)
        Demand above what the inverters in service can take, asked of no string.
    rollouts : int
        Roll-outs of the control model that were spent.
    bound : float
        Lower bound of the cost of every schedule on the control model of :func:`bess.rollout`
        (docs/equations.md, 1 to 6), proven, starts left out: by prices of the balance, or the sum of the
        least costs of single steps, whichever is higher. NaN where it was not computed.
    search_bound : float
        Lower bound by prices of the balance, on a grid: an estimate. NaN where it was not computed.
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
        """Share of the cost by which the plan may be above the best, proven."""
        return (self.cost - self.bound) / self.cost if self.cost > 0.0 else 0.0

    @property
    def search_gap(self) -> float:
        """Share of the cost by which the plan may be above the best, as far as the search bound says.

        The grid puts that bound up to about 0.5 % of the cost too high; a gap below 0 is therefore 0.
        """
        return float(np.maximum((self.cost - self.search_bound) / self.cost, 0.0)) if self.cost > 0.0 else 0.0


class Planner:
    """Plans the power of every string over hours or days (docs/foresight.md).

    Each call takes the measured state and the demand ahead, moves the plan of the call before on by one step,
    and improves it by a local search on the control model in its midpoint form. The best schedule of a rule
    takes the place of a plan that costs more. Nothing depends on the clock: results repeat to the last bit.

    Parameters
    ----------
    system : System
        1 to 32 strings, which may differ.
    n_steps : int
        Length of the plan [steps].
    dt_h : float
        Length of a step [h].
    rollouts : int
        Effort of a call, in roll-outs of all strings over the whole plan.
    balance : float
        Price of imbalance [1/h]: the squared distance of a string's fill (share of its SOC window) from the
        plant's, times its nominal energy, times the mean price of losses, costs this much for each hour.
        It counts where the plant will come near empty or full, and more where little came as foreseen.
    bound_passes : int
        Passes of the bound by prices in the first call and every :data:`BOUND_STEPS` calls; the plan then
        also starts from the schedules that come with the bound.
    proof_cells : int
        Cells of SOC in which the bound is proven; the work grows with their third power.
    known : bool
        Whether what is foreseen is known for certain, so that all steps count alike.

    Raises
    ------
    InputError
        A parameter out of range.
    """

    def __init__(
        self,
        system: System,
        n_steps: int,
        dt_h: float = 0.25,
        *,
        rollouts: int = ROLLOUTS,
        balance: float = BALANCE_PER_H,
        bound_passes: int = BOUND_PASSES,
        proof_cells: int = PROOF_CELLS,
        known: bool = False,
    ) -> None:
        check_horizon(system, n_steps, dt_h, "n_steps", MOST_STEPS)
        if rollouts < 0:
            raise InputError(f"rollouts = {rollouts}: must be >= 0")
        self.system = system
        self.n_steps = int(n_steps)
        self.dt_h = dt_h
        self.rollouts = int(rollouts)
        self._balance = balance
        self.bound_passes = int(bound_passes)
        self._proof_cells = proof_cells
        self._known = known
        self._mistrust = Mistrust(system.nominal_kw, dt_h)
        self._request_kw: Array | None = None
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
            What counts.
        ambient_c : float or array_like, shape (n_steps,), optional
            Ambient temperature [degC]; the system's by default. Of a system with cooling, what its strings
            cool towards (:meth:`~bess.System.surroundings_c`).
        limit_kw : array_like, shape (n_strings,), optional
            Largest power of each inverter over the whole plan [kW]; 0 takes a string out of service.
        reactive_kvar : array_like, shape (n_steps,), optional
            Reactive power asked of the plant [kvar]. The plan counts the losses of apparent power, as if
            every string had the power factor of the plant (docs/equations.md, R4).

        Raises
        ------
        InputError
            If something given does not fit the system or the plan; nothing is done then.
        """
        if np.ndim(self.system.nominal_kw if limit_kw is None else limit_kw) != 1:
            raise InputError("limit_kw: give one value for each string; it holds for the whole plan")
        if prices.losses.shape != (self.n_steps, 4):
            raise InputError(
                f"prices of losses have shape {prices.losses.shape}; the plan needs {(self.n_steps, 4)}"
            )
        problem = SplitProblem.check(
            self.system, self.n_steps, self.dt_h, state, demand_kw, ambient_c, limit_kw
        )
        limit = np.ascontiguousarray(problem.limit_kw[:, 0])
        if reactive_kvar is not None:
            values = real_numbers(reactive_kvar)
            reactive_kvar = values if values.any() else None
        changed = self._mistrust.compare(np.atleast_1d(np.asarray(demand_kw, dtype=np.float64)), limit)
        previous, running = self._moved_on(), self._running()
        fresh = previous is None or changed or self._turn % FRESH_STEPS == 0
        loss_prices = prices.losses * self._certainty()
        try:
            plan = _core.plan(
                self.system.control_at(state),
                soc=state.soc,
                temperature_c=state.temperature_c,
                running=running,
                demand_kw=problem.demand_kw,
                ambient_c=problem.ambient_c,
                dt_h=self.dt_h,
                limit_kw=limit,
                loss_prices=loss_prices,
                wear=prices.wear,
                start_cost=prices.start,
                balance=self._imbalance_price() * float(prices.losses[:, 2:].mean()),
                end_charge=END_SHARE * self._start_charge,
                previous_kw=previous,
                rollouts=self.rollouts,
                fresh_rollouts=min(FRESH_ROLLOUTS, 4 * self.rollouts) if fresh else 0,
                bound_passes=self.bound_passes if self._turn % BOUND_STEPS == 0 else 0,
                proof_cells=self._proof_cells,
                turn=self._turn,
                reactive_kvar=reactive_kvar,
            )
        except ValueError as error:
            raise InputError(f"plan: {error}") from error
        self._request_kw = plan.request_kw
        self._start_charge = plan.start_charge
        self._turn += 1
        proven, searched = np.nan, plan.search_bound
        if searched is not None:
            of_steps = proven_bound(problem, loss_prices.min(axis=0))
            proven = of_steps if plan.bound is None else max(of_steps, plan.bound)
        return Plan(
            plan.request_kw,
            plan.cost,
            plan.rule_cost,
            problem.unmet_kw,
            plan.rollouts,
            proven,
            np.nan if searched is None else searched,
        )

    def skip(self, demand_kw: ArrayLike) -> None:
        """Let a step pass in which nothing is asked; ``demand_kw`` as in a call."""
        self._mistrust.compare(np.asarray(demand_kw, dtype=np.float64))
        self._request_kw = self._moved_on()
        if self._request_kw is not None:
            self._request_kw[:, 0] = 0.0

    def memory(self) -> dict[str, Any]:
        """What the next call depends on."""
        return {
            "request_kw": self._request_kw,
            "start_charge": self._start_charge,
            "turn": self._turn,
            **self._mistrust.memory(),
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
        self._request_kw = memory["request_kw"]
        self._start_charge, self._turn = float(memory["start_charge"]), int(memory["turn"])
        self._mistrust.recall(memory)

    def _imbalance_price(self) -> float:
        """Price of imbalance [kWh/Ah/h]; the core counts charge, energy is charge times mean voltage."""
        kwh_per_ah = float(self.system.nominal_energy_kwh.sum() / self.system.capacity_ah.sum())
        return (self._balance + MISTRUSTED_BALANCE_PER_H * self._mistrust.share) * kwh_per_ah

    def _certainty(self) -> Array:
        """Weights of the four losses in each step, shape (n_steps, 4): a shortfall later counts less."""
        if self._known:
            return np.ones((self.n_steps, 4))
        mistrust = self._mistrust.share
        hours = np.arange(self.n_steps) * self.dt_h
        shortfall = np.exp(-hours * (1.0 / DOUBT_H + mistrust / MISTRUSTED_DOUBT_H))
        shortfall[0] *= URGENCY + MISTRUSTED_URGENCY * mistrust
        return np.stack([shortfall, shortfall, *2 * [np.ones(self.n_steps)]], axis=1)

    def _moved_on(self) -> Array | None:
        """The last plan from its second step on; what its new last step asks for is still to be shared."""
        if self._request_kw is None:
            return None
        moved = np.zeros_like(self._request_kw)
        moved[:, :-1] = self._request_kw[:, 1:]
        return moved

    def _running(self) -> NDArray[np.bool_]:
        """Inverters that the plan of the step before had switched on."""
        if self._request_kw is None:
            return np.zeros(self.system.n_strings, dtype=bool)
        return np.asarray(self._request_kw[:, 0] != 0.0)
