"""What is asked of the plant in each step, and what the policy is told of the steps ahead."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bess.numbers import Array
from bess.parameters import State, System

if TYPE_CHECKING:
    from bess.ems import Arbitrage, AwareDispatch, Forecast


COMPARE_H = 3.0
"""How often what has come is compared with what a plan over prices counts on."""
LONGEST_SHARE = 1.0 / 6.0
"""Share of a plan after which it is made anew all the same: what lies behind its end comes into sight."""
LONGEST_H = 6.0
"""Time after which a plan is made anew at the latest [h]: later hours are planned in less detail."""
ENERGY_TOLERANCE = 0.02
"""Distance of the stored energy from the plan, over the plant's capacity, at which it is made anew."""
TEMPERATURE_TOLERANCE_K = 3.0
"""The same of the mean temperature."""


@dataclass(frozen=True)
class Now:
    """What is measured and known when a step begins.

    Attributes
    ----------
    state : State
        Measured state of every string.
    limit_kw : ndarray, shape (n_strings,)
        Power of each inverter in service.
    ambient_c : ndarray, shape (n_steps_left,)
        Ambient temperature of this step and those to come, as a weather forecast has it.
    delivered_kw : float
        Mean power of the plant in the step before, positive = discharge.
    """

    state: State
    limit_kw: Array
    ambient_c: Array
    delivered_kw: float = 0.0


class DemandSource(Protocol):
    """Gives the demand of a step and its forecast; what it remembers is part of a checkpoint."""

    follows_store: bool
    """See :class:`bess.policies.Situation`."""

    def ahead(self, step: int, horizon: int, now: Now) -> Array:
        """Demand [kW] of ``step`` (binding) and as foreseen for the next ones, shape ``(horizon,)``.

        Called once for each step, in order.
        """

    def planned(self, step: int) -> dict[str, float]:
        """What a plan says of ``step``, by names of the record, after :meth:`ahead`; empty without a plan."""

    def memory(self) -> dict[str, Any]:
        """What is carried from step to step."""

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""


class ProfileSource:
    """A series that is known; after its end nothing is asked."""

    follows_store = False

    def __init__(self, forecast: Forecast) -> None:
        self._forecast = forecast

    def ahead(self, step: int, horizon: int, now: Now) -> Array:
        """See :class:`DemandSource`."""
        return padded(self._forecast.ahead(step, horizon), horizon)

    def planned(self, step: int) -> dict[str, float]:
        """A profile promises nothing."""
        return {}

    def memory(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Nothing to restore."""


@dataclass(frozen=True)
class MarketPlan:
    """A plan over prices, and what it counts on; arrays over its steps.

    Attributes
    ----------
    step : int
        Its first step.
    demand_kw, delivered_kw : ndarray
        What is asked of the plant, and what of it the plan expects to be delivered.
    limit_kw : ndarray, shape (n_strings,)
        Power of each inverter in service.
    energy_kwh, temperature_c : ndarray
        Of the plant at the end of each step; empty where the plan has no opinion.
    """

    step: int
    demand_kw: Array
    delivered_kw: Array
    limit_kw: Array
    energy_kwh: Array
    temperature_c: Array


class DispatchPlanner(Protocol):
    """Makes plans over prices, each from its arguments alone."""

    @property
    def days(self) -> NDArray[np.int64]:
        """Number of the trading day of each step."""

    def is_due(self, step: int, now: Now, plan: MarketPlan) -> bool:
        """Whether ``plan``, the last one, is to be made anew."""

    def plan(self, step: int, now: Now, energy_kwh: float, discharged_kwh: float) -> MarketPlan:
        """Plan over the look-ahead.

        ``energy_kwh`` is stored above the lower SOC limits, ``discharged_kwh`` what of it was discharged on
        this trading day so far.
        """


class LinearPlanner:
    """The arbitrage program with a constant efficiency, which expects that what it asks is delivered."""

    def __init__(self, arbitrage: Arbitrage) -> None:
        self._arbitrage = arbitrage
        self.days = arbitrage.days

    def is_due(self, step: int, now: Now, plan: MarketPlan) -> bool:
        """See :class:`DispatchPlanner`."""
        return self._arbitrage.is_due(step)

    def plan(self, step: int, now: Now, energy_kwh: float, discharged_kwh: float) -> MarketPlan:
        """See :class:`DispatchPlanner`."""
        demand_kw = self._arbitrage.plan(step, energy_kwh, discharged_kwh)
        return MarketPlan(step, demand_kw, demand_kw, now.limit_kw, np.zeros(0), np.zeros(0))


class AwarePlanner:
    """Plans that know the plant.

    With ``replan_steps`` a plan is made anew after so many steps; without, when what it counts on has
    changed, and after ``longest_steps``.
    """

    def __init__(
        self,
        dispatch: AwareDispatch,
        prices: Forecast,
        days: NDArray[np.int64],
        *,
        look_ahead_steps: int,
        replan_steps: int | None,
        compare_steps: int,
        longest_steps: float,
    ) -> None:
        self._dispatch, self._prices, self.days = dispatch, prices, days
        self._look_ahead_steps, self._replan_steps = look_ahead_steps, replan_steps
        self._compare_steps, self._longest_steps = compare_steps, longest_steps

    def is_due(self, step: int, now: Now, plan: MarketPlan) -> bool:
        """See :class:`DispatchPlanner`."""
        if self._replan_steps is not None:
            return step % self._replan_steps == 0
        age = step - plan.step
        if not np.array_equal(now.limit_kw, plan.limit_kw) or age >= self._longest_steps:
            return True
        return age > 0 and age % self._compare_steps == 0 and not self._came_true(step, now, plan)

    def _came_true(self, step: int, now: Now, plan: MarketPlan) -> bool:
        """Whether prices are foreseen as they were, and the plant is where the plan has it."""
        age, n_steps = step - plan.step, plan.demand_kw.size
        before = self._prices.ahead(plan.step, n_steps)[age:]
        if not np.array_equal(before, self._prices.ahead(step, n_steps - age)):
            return False
        energy_kwh, capacity_kwh, temperature_c = self._dispatch.condition(now.state, now.limit_kw)
        off_kwh = abs(energy_kwh - float(plan.energy_kwh[age - 1]))
        off_k = abs(temperature_c - float(plan.temperature_c[age - 1]))
        return off_kwh <= ENERGY_TOLERANCE * capacity_kwh and off_k <= TEMPERATURE_TOLERANCE_K

    def plan(self, step: int, now: Now, energy_kwh: float, discharged_kwh: float) -> MarketPlan:
        """See :class:`DispatchPlanner`."""
        from bess.ems import Outlook

        price = self._prices.ahead(step, self._look_ahead_steps)
        outlook = Outlook(
            price,
            now.ambient_c[: price.size],
            self.days[step : step + price.size],
            discharged_kwh,
            is_last=step + price.size == self.days.size,
        )
        plan = self._dispatch.plan(outlook, now.state, limit_kw=now.limit_kw)
        return MarketPlan(
            step,
            plan.demand_kw,
            plan.expected_delivered_kw,
            now.limit_kw,
            plan.expected_energy_kwh,
            plan.expected_temperature_c,
        )


class ArbitrageSource:
    """A plan over prices, made anew whenever it is due."""

    follows_store = False

    def __init__(self, planner: DispatchPlanner, system: System) -> None:
        self._planner = planner
        self._soc_min = np.array([string.battery.soc_min for string in system.strings])
        self._nominal_kwh = system.nominal_energy_kwh
        self._plan: MarketPlan | None = None
        self._day: int | None = None
        self._energy_kwh = 0.0
        self._discharged_kwh = 0.0

    def ahead(self, step: int, horizon: int, now: Now) -> Array:
        """See :class:`DemandSource`."""
        state = now.state
        held_kwh = (state.soc - self._soc_min) * self._nominal_kwh * state.soh_capacity
        self._count_discharge(int(self._planner.days[step]), float(held_kwh.sum()))
        if self._plan is None or self._planner.is_due(step, now, self._plan):
            self._plan = self._planner.plan(step, now, self._energy_kwh, self._discharged_kwh)
        offset = step - self._plan.step
        return padded(self._plan.demand_kw[offset : offset + horizon], horizon)

    def planned(self, step: int) -> dict[str, float]:
        """See :class:`DemandSource`."""
        assert self._plan is not None
        return {"expected_kw": float(self._plan.delivered_kw[step - self._plan.step])}

    def memory(self) -> dict[str, Any]:
        """The plan, and what counts against the cycle limit of the day."""
        return {
            "plan": None if self._plan is None else vars(self._plan),
            "day": self._day,
            "energy_kwh": self._energy_kwh,
            "discharged_kwh": self._discharged_kwh,
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """See :class:`DemandSource`."""
        plan = memory["plan"]
        self._plan = None if plan is None else MarketPlan(**plan)
        self._day = memory["day"]
        self._energy_kwh = memory["energy_kwh"]
        self._discharged_kwh = memory["discharged_kwh"]

    def _count_discharge(self, day: int, energy_kwh: float) -> None:
        """Count what left the store in the step before; a step at midnight counts for the day it ended."""
        if day == self._day:
            self._discharged_kwh += max(0.0, self._energy_kwh - energy_kwh)
        else:
            self._discharged_kwh = 0.0
        self._day, self._energy_kwh = day, energy_kwh


def padded(values: Array, horizon: int) -> Array:
    """Nothing is asked after the end of the series."""
    return np.concatenate([values, np.zeros(horizon - values.size)])
