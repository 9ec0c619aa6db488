"""Demand on the plant in each step, and the demand forecast of the policy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.system import State, System

if TYPE_CHECKING:
    from bess.dispatch import (
        Arbitrage,
        BandForecast,
        DynamicProgramDispatch,
        Forecast,
        GridConnection,
    )
    from bess.dispatch.budget import CycleBudget


COMPARE_H = 3.0
"""Interval between comparisons of the measured state with a dispatch plan [h]."""
MAX_PLAN_AGE_FRACTION = 1.0 / 6.0
"""Maximum age of a plan as a share of its length: a new plan includes steps beyond the end of the old one."""
LONGEST_H = 6.0
"""Maximum age of a plan [h]: its later hours have a coarser resolution."""
ENERGY_TOLERANCE = 0.02
"""Deviation of the stored energy from the plan, relative to plant capacity, that triggers a new plan."""
TEMPERATURE_TOLERANCE_K = 3.0
"""Deviation of the mean temperature from the plan [K] that triggers a new plan."""


@dataclass(frozen=True)
class StepInputs:
    """Measurements and forecasts at the start of a step.

    Attributes
    ----------
    state : State
        Measured state of every string.
    limit_kw : ndarray, shape (n_strings,)
        Power of each inverter in service.
    ambient_c : ndarray, shape (n_steps_left,)
        Ambient temperature of this step and the remaining steps, as in a weather forecast.
    delivered_kw : float
        Mean power of the plant in the previous step, positive = discharge.
    """

    state: State
    limit_kw: Array
    ambient_c: Array
    delivered_kw: float = 0.0


class DemandSource(Checkpointed, ABC):
    """Returns the demand of a step and its forecast; its state is part of a checkpoint."""

    demand_depends_on_soc = False
    """See :class:`bess.control.policies.PolicyInput`."""

    @abstractmethod
    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """Return the demand [kW] of ``step`` (binding) and the forecast of the next ones, ``(horizon,)``.

        Called once for each step, in order.
        """

    def planned(self, step: int) -> dict[str, float]:
        """Return planned values of ``step`` by record name, after :meth:`ahead`; empty without a plan."""
        return {}


class KnownDemand(DemandSource):
    """Demand of several steps that does not depend on measurements within them."""

    @abstractmethod
    def block(self, step: int, most: int, horizon: int, now: StepInputs) -> Array:
        """Return :meth:`ahead` of ``step`` and the next ones, ``(n_steps, horizon)``.

        It covers at most ``most`` steps that do not depend on measurements after ``now``, with the same
        inverters in service.
        """

    def measured(self, step: int, soc: Array, soh_capacity: Array) -> None:
        """Record the states at the start of ``step``, a later step of the last :meth:`block`."""


class ProfileSource(KnownDemand):
    """A known series; the demand after its end is zero."""

    def __init__(self, forecast: Forecast) -> None:
        self._forecast = forecast

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`DemandSource`."""
        return padded(self._forecast.ahead(step, horizon), horizon)

    def block(self, step: int, most: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`KnownDemand`."""
        return np.array([self.ahead(each, horizon, now) for each in range(step, step + most)])


@dataclass(frozen=True)
class MarketPlan:
    """A dispatch plan and its expected states; arrays over its steps.

    Attributes
    ----------
    step : int
        First step of the plan.
    demand_kw, delivered_kw : ndarray
        Planned demand, and its expected delivery.
    limit_kw : ndarray, shape (n_strings,)
        Power of each inverter in service.
    energy_kwh, temperature_c : ndarray
        Expected stored energy and temperature of the plant at the end of each step; empty if not planned.
    """

    step: int
    demand_kw: Array
    delivered_kw: Array
    limit_kw: Array
    energy_kwh: Array
    temperature_c: Array


@dataclass(frozen=True)
class Stored:
    """Initial values of a dispatch plan.

    Attributes
    ----------
    energy_kwh, discharged_kwh : float
        Stored energy above the lower SOC limits, and energy discharged on this trading day so far.
    budget_price_eur_mwh, remaining_kwh : float
        Shadow price of a budget per MWh discharged, and stored energy that may still be discharged.
    """

    energy_kwh: float
    discharged_kwh: float
    budget_price_eur_mwh: float = 0.0
    remaining_kwh: float = np.inf


class LinearPlanner:
    """The arbitrage program with a constant efficiency, which assumes full delivery.

    ``days`` is the number of the trading day of each step.
    """

    def __init__(self, arbitrage: Arbitrage) -> None:
        self._arbitrage = arbitrage
        self.days = arbitrage.days

    def is_due(self, step: int, now: StepInputs, plan: MarketPlan) -> bool:
        """Whether the last plan must be replaced."""
        return self.may_be_due(step, plan)

    def may_be_due(self, step: int, plan: MarketPlan) -> bool:
        """Whether ``plan`` may be replaced at ``step`` with the same inverters in service."""
        return self._arbitrage.is_due(step)

    def plan(self, step: int, now: StepInputs, stored: Stored) -> MarketPlan:
        """Plan over the look-ahead; the plan depends on the arguments only."""
        demand_kw = self._arbitrage.plan(
            step,
            stored.energy_kwh,
            stored.discharged_kwh,
            budget_price_eur_mwh=stored.budget_price_eur_mwh,
            remaining_kwh=stored.remaining_kwh,
        )
        return MarketPlan(step, demand_kw, demand_kw, now.limit_kw, np.zeros(0), np.zeros(0))


class AwarePlanner:
    """Plans by dynamic programming on the plant model.

    With ``replan_steps``, a plan is re-optimised after this number of steps. Otherwise it is re-optimised
    when prices or states deviate from it, and after ``longest_steps``. With ``bands``, future prices move
    between their levels, with mean ``prices``; otherwise ``prices`` are taken as certain.
    """

    def __init__(
        self,
        dispatch: DynamicProgramDispatch,
        prices: Forecast,
        days: NDArray[np.int64],
        *,
        look_ahead_steps: int,
        replan_steps: int | None,
        compare_steps: int,
        longest_steps: float,
        bands: BandForecast | None = None,
    ) -> None:
        self._dispatch, self._prices, self._bands, self.days = dispatch, prices, bands, days
        self._look_ahead_steps, self._replan_steps = look_ahead_steps, replan_steps
        self._compare_steps, self._longest_steps = compare_steps, longest_steps

    def is_due(self, step: int, now: StepInputs, plan: MarketPlan) -> bool:
        """See :class:`LinearPlanner`."""
        if self._replan_steps is not None:
            return self.may_be_due(step, plan)
        if not np.array_equal(now.limit_kw, plan.limit_kw):
            return True
        if not self.may_be_due(step, plan):
            return False
        return self._is_outdated(step, plan) or not self._came_true(step, now, plan)

    def may_be_due(self, step: int, plan: MarketPlan) -> bool:
        """See :class:`LinearPlanner`."""
        if self._replan_steps is not None:
            return step % self._replan_steps == 0
        age = step - plan.step
        return self._is_outdated(step, plan) or (age > 0 and age % self._compare_steps == 0)

    def _is_outdated(self, step: int, plan: MarketPlan) -> bool:
        """Whether the plan is too old, or the present price differs from that of the plan."""
        age = step - plan.step
        new_price = self._prices.ahead(step, 1)[0] != self._prices.ahead(plan.step, age + 1)[age]
        return bool(new_price) or age >= self._longest_steps

    def _came_true(self, step: int, now: StepInputs, plan: MarketPlan) -> bool:
        """Whether the price forecast is unchanged and the plant follows the plan."""
        age, n_steps = step - plan.step, plan.demand_kw.size
        before = self._prices.ahead(plan.step, n_steps)[age:]
        if not np.array_equal(before, self._prices.ahead(step, n_steps - age)):
            return False
        energy_kwh, capacity_kwh, temperature_c = self._dispatch.condition(now.state, now.limit_kw)
        off_kwh = abs(energy_kwh - float(plan.energy_kwh[age - 1]))
        off_k = abs(temperature_c - float(plan.temperature_c[age - 1]))
        return off_kwh <= ENERGY_TOLERANCE * capacity_kwh and off_k <= TEMPERATURE_TOLERANCE_K

    def plan(self, step: int, now: StepInputs, stored: Stored) -> MarketPlan:
        """See :class:`LinearPlanner`."""
        from bess.dispatch import DispatchInputs

        price = self._prices.ahead(step, self._look_ahead_steps)
        inputs = DispatchInputs(
            price,
            now.ambient_c[: price.size],
            self.days[step : step + price.size],
            stored.discharged_kwh,
            is_last=step + price.size == self.days.size,
            budget_price_eur_mwh=stored.budget_price_eur_mwh,
            remaining_kwh=stored.remaining_kwh,
            bands=None if self._bands is None else self._bands.bands(step, self._look_ahead_steps),
        )
        plan = self._dispatch.plan(inputs, now.state, limit_kw=now.limit_kw)
        return MarketPlan(
            step,
            plan.demand_kw,
            plan.expected_delivered_kw,
            now.limit_kw,
            plan.expected_energy_kwh,
            plan.expected_temperature_c,
        )


class ArbitrageSource(KnownDemand):
    """A dispatch plan that is re-optimised when due."""

    _carried = ("_day", "_energy_kwh", "_discharged_kwh", "_budget", "_connection")

    def __init__(
        self,
        planner: LinearPlanner | AwarePlanner,
        system: System,
        budget: CycleBudget | None = None,
        connection: GridConnection | None = None,
    ) -> None:
        self._planner, self._budget, self._connection = planner, budget, connection
        self._dt_h = system.control.step_min / 60.0
        self._soc_min = np.array([string.battery.soc_min for string in system.strings])
        self._nominal_kwh = system.nominal_energy_kwh
        self._plan: MarketPlan | None = None
        self._day: int | None = None
        self._energy_kwh = 0.0
        self._discharged_kwh = 0.0

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`DemandSource`."""
        state = now.state
        self.measured(step, state.soc, state.soh_capacity)
        budget = self._budget
        if budget is not None:
            budget.advance(step, state.soc, now.delivered_kw)
        if self._connection is not None:
            self._connection.advance(step, now.delivered_kw)
        if self._plan is None or self._planner.is_due(step, now, self._plan):
            stored = Stored(self._energy_kwh, self._discharged_kwh)
            if budget is not None:
                stored = replace(
                    stored, budget_price_eur_mwh=budget.price_eur_mwh, remaining_kwh=budget.remaining_kwh
                )
            self._plan = self._planner.plan(step, now, stored)
        offset = step - self._plan.step
        demand_kw = padded(self._plan.demand_kw[offset : offset + horizon], horizon)
        if self._connection is not None:
            max_kw = min(self._energy_kwh / self._dt_h, float(now.limit_kw.sum()))
            demand_kw[0] = self._connection.limited(step, float(demand_kw[0]), max_kw)
        if budget is None:
            return demand_kw
        return budget.limited(demand_kw, float((self._nominal_kwh * state.soh_capacity).min()))

    def block(self, step: int, most: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`KnownDemand`."""
        rows = [self.ahead(step, horizon, now)]
        plan = self._plan
        assert plan is not None
        if self._budget is None and self._connection is None:
            for each in range(step + 1, min(step + most, plan.step + plan.demand_kw.size)):
                if self._planner.may_be_due(each, plan):
                    break
                offset = each - plan.step
                rows.append(padded(plan.demand_kw[offset : offset + horizon], horizon))
        return np.array(rows)

    def measured(self, step: int, soc: Array, soh_capacity: Array) -> None:
        """Add the energy discharged in the previous step; a step that ends at midnight counts for its day."""
        stored_kwh = (soc - self._soc_min) * self._nominal_kwh * soh_capacity
        day, energy_kwh = int(self._planner.days[step]), float(stored_kwh.sum())
        if day == self._day:
            self._discharged_kwh += max(0.0, self._energy_kwh - energy_kwh)
        else:
            self._discharged_kwh = 0.0
        self._day, self._energy_kwh = day, energy_kwh

    def planned(self, step: int) -> dict[str, float]:
        """See :class:`DemandSource`."""
        assert self._plan is not None
        row = {"expected_kw": float(self._plan.delivered_kw[step - self._plan.step])}
        return row if self._budget is None else row | self._budget.recorded()

    def state_dict(self) -> dict[str, Any]:
        """See :class:`DemandSource`."""
        return super().state_dict() | {"plan": None if self._plan is None else vars(self._plan)}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """See :class:`DemandSource`."""
        super().load_state_dict(state_dict)
        self._plan = None if state_dict["plan"] is None else MarketPlan(**state_dict["plan"])


def padded(values: Array, horizon: int) -> Array:
    """Pad the series with zero demand."""
    return np.concatenate([values, np.zeros(horizon - values.size)])
