"""Dispatch plans of a demand at market prices, and when they are replaced."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.dispatch import (
    Arbitrage,
    BandForecast,
    DispatchInputs,
    DispatchPlan,
    DynamicProgramDispatch,
    Forecast,
)
from bess.dispatch.aggregate import counted
from bess.study.demands.source import StepInputs
from bess.system import State, System

COMPARE_H = 3.0
"""Interval between comparisons of the measured state with a dispatch plan [h]."""
MAX_PLAN_AGE_FRACTION = 1.0 / 6.0
"""Maximum age of a plan as a share of its length: a new plan includes steps beyond the end of the old one."""
MAX_PLAN_AGE_H = 6.0
"""Maximum age of a plan [h]: its later hours have a coarser resolution."""
ENERGY_TOLERANCE = 0.02
"""Deviation of the stored energy from the plan, relative to plant capacity, that triggers a new plan."""
TEMPERATURE_TOLERANCE_K = 3.0
"""Deviation of the mean temperature from the plan [K] that triggers a new plan."""


@dataclass(frozen=True, eq=False)
class MarketPlan(DispatchPlan):
    """A dispatch plan from ``step`` on, at prices as forecast there.

    ``limit_kw`` is the power of each inverter in service. The expected energy and temperature of a linear
    plan are empty.
    """

    step: int
    limit_kw: Array
    price_eur_mwh: Array


def nominal_stored_kwh(system: System, soc: Array, soh_capacity: Array) -> Array:
    """Energy of each string above its lower SOC limit, at nominal voltage."""
    return np.asarray((soc - system.soc_window[0]) * system.nominal_energy_kwh * soh_capacity)


@dataclass(frozen=True, eq=False)
class LinearPlanner:
    """The arbitrage program with a constant efficiency, which assumes full delivery."""

    arbitrage: Arbitrage
    system: System

    @property
    def days(self) -> NDArray[np.int64]:
        """Number of the trading day of each step."""
        return self.arbitrage.days

    def wear_eur_mwh(self, state: State, limit_kw: Array) -> float:
        """Return the wear cost of a MWh discharged as plans include it: none."""
        return 0.0

    def is_due(self, step: int, now: StepInputs | None, plan: MarketPlan) -> bool:
        """Whether ``plan`` is replaced at ``step``; without ``now``, whether it may be.

        Without ``now``, the same inverters as in the plan are in service.
        """
        outage = now is not None and not np.array_equal(now.limit_kw, plan.limit_kw)
        return outage or self.arbitrage.is_due(step)

    def plan(self, step: int, now: StepInputs, discharged_kwh: float, **budget: float) -> MarketPlan:
        """Plan over the look-ahead, from the measured state and the energy discharged on this day so far.

        ``budget`` is that of :meth:`bess.dispatch.CycleBudget.for_plan`. The plan depends on the arguments
        only.
        """
        (low, high), counts = self.system.soc_window, counted(now.limit_kw)
        capacity_kwh = self.system.nominal_energy_kwh * (high - low) * now.state.soh_capacity
        stored_kwh = nominal_stored_kwh(self.system, now.state.soc, now.state.soh_capacity)
        demand_kw = self.arbitrage.plan(
            step,
            float(stored_kwh[counts].sum()),
            discharged_kwh,
            available_kw=float(now.limit_kw.sum()),
            available_kwh=float(capacity_kwh[counts].sum()),
            **budget,
        )
        none = np.zeros(0)
        return MarketPlan(demand_kw, demand_kw, np.nan, none, none, step, now.limit_kw, none)


@dataclass(frozen=True, eq=False)
class AwarePlanner:
    """Plans by dynamic programming on the plant model.

    With ``replan_steps``, a plan is re-optimised after this number of steps. Otherwise it is re-optimised
    when prices or states deviate from it, and at its maximum age. With ``bands``, future prices move
    between their levels, with mean ``prices``; otherwise ``prices`` are taken as certain.
    """

    dispatch: DynamicProgramDispatch
    prices: Forecast
    days: NDArray[np.int64]
    dt_h: float
    look_ahead_steps: int
    replan_steps: int | None = None
    bands: BandForecast | None = None

    def wear_eur_mwh(self, state: State, limit_kw: Array) -> float:
        """Return the wear cost of a MWh discharged as plans include it."""
        return self.dispatch.wear_eur_mwh(state, limit_kw)

    def is_due(self, step: int, now: StepInputs | None, plan: MarketPlan) -> bool:
        """See :class:`LinearPlanner`."""
        if self.replan_steps is not None:
            return step % self.replan_steps == 0
        if now is not None and not np.array_equal(now.limit_kw, plan.limit_kw):
            return True
        age = step - plan.step
        max_steps = min(MAX_PLAN_AGE_FRACTION * self.look_ahead_steps, MAX_PLAN_AGE_H / self.dt_h)
        if age >= max_steps or self.prices.ahead(step, 1)[0] != plan.price_eur_mwh[age]:
            return True
        is_compared = age > 0 and age % max(1, round(COMPARE_H / self.dt_h)) == 0
        return is_compared and (now is None or not self._came_true(step, now, plan))

    def _came_true(self, step: int, now: StepInputs, plan: MarketPlan) -> bool:
        """Whether the price forecast is unchanged and the plant follows the plan."""
        age = step - plan.step
        before = plan.price_eur_mwh[age:]
        if not np.array_equal(before, self.prices.ahead(step, before.size)):
            return False
        energy_kwh, capacity_kwh, temperature_c = self.dispatch.condition(now.state, now.limit_kw)
        off_kwh = abs(energy_kwh - float(plan.expected_energy_kwh[age - 1]))
        off_k = abs(temperature_c - float(plan.expected_temperature_c[age - 1]))
        return off_kwh <= ENERGY_TOLERANCE * capacity_kwh and off_k <= TEMPERATURE_TOLERANCE_K

    def plan(self, step: int, now: StepInputs, discharged_kwh: float, **budget: float) -> MarketPlan:
        """See :class:`LinearPlanner`."""
        price = self.prices.ahead(step, self.look_ahead_steps)
        inputs = DispatchInputs(
            price,
            now.ambient_c[: price.size],
            self.days[step : step + price.size],
            discharged_kwh,
            is_last=step + price.size == self.days.size,
            bands=None if self.bands is None else self.bands.bands(step, self.look_ahead_steps),
            **budget,
        )
        plan = self.dispatch.plan(inputs, now.state, limit_kw=now.limit_kw)
        return MarketPlan(**vars(plan), step=step, limit_kw=now.limit_kw, price_eur_mwh=price)
