"""Demand of grid services on the plant in each step, from its measured state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.dispatch import (
    Arbitrage,
    CycleBudget,
    EnergyWindow,
    Forecast,
    GridPowerTarget,
    RechargeScheduler,
    Store,
)
from bess.simulation.demand import StepInputs, padded


class ZeroResponseForecast:
    """Forecast of a frequency response: the measured value in this step, and zero (the mean) in later steps.

    Parameters
    ----------
    values : ndarray, shape (n_steps,)
        Actual response [kW].
    """

    def __init__(self, values: Array) -> None:
        self._values = values

    def ahead(self, step: int, horizon: int) -> Array:
        """See :class:`bess.dispatch.Forecast`."""
        seen = np.zeros(min(horizon, self._values.size - step))
        seen[0] = self._values[step]
        return seen


class MeterSource:
    """A battery that keeps the power at the meter at a target (:class:`~bess.dispatch.GridPowerTarget`)."""

    demand_depends_on_soc = True

    def __init__(
        self, net_kw: Forecast, level: GridPowerTarget, level_kw: Array, store: Store, ready_soc: float
    ) -> None:
        self._net_kw, self._level, self._level_kw = net_kw, level, level_kw
        self._store, self._ready_soc = store, ready_soc

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`bess.simulation.demand.DemandSource`."""
        state = now.state
        self._store.count(state, now.delivered_kw * self._level.dt_h)
        net_kw = self._net_kw.ahead(step, horizon)
        level = replace(
            self._level,
            level_kw=self._level_kw[step : step + net_kw.size],
            one_way=self._store.one_way,
            power_kw=min(self._level.power_kw, float(now.limit_kw.sum())),
            full_kwh=self._store.size_kwh(state, self._ready_soc),
        )
        return padded(level.demand_kw(net_kw, self._store.held_kwh(state)), horizon)

    def planned(self, step: int) -> dict[str, float]:
        """Return no further planned values."""
        return {}

    def memory(self) -> dict[str, Any]:
        """Return the state of the storage estimator."""
        return self._store.memory()

    def recall(self, memory: Mapping[str, Any]) -> None:
        """See :class:`bess.simulation.demand.DemandSource`."""
        self._store.recall(memory)


@dataclass(frozen=True)
class Reserve:
    """Sold reserve.

    Attributes
    ----------
    capacity_kw : ndarray, shape (n_steps,)
        Symmetric reserve.
    duration_min : float
        Duration for which the full reserve must be sustained.
    band : float
        Share of the required window without recharge.
    """

    capacity_kw: Array
    duration_min: float
    band: float


@dataclass
class Trade:
    """Dispatch plans with the power and energy outside the reserve."""

    arbitrage: Arbitrage
    days: NDArray[np.int64]


class ReserveSource:
    """Frequency response, scheduled recharge, and optional trade."""

    demand_depends_on_soc = False

    def __init__(
        self,
        response_kw: Forecast,
        reserve: Reserve,
        recharge: RechargeScheduler,
        store: Store,
        trade: Trade | None,
        budget: CycleBudget | None = None,
    ) -> None:
        self._response_kw, self._reserve, self._store = response_kw, reserve, store
        self._recharge, self._trade, self._budget = recharge, trade, budget
        self._max_capacity_kw = float(reserve.capacity_kw.max())
        self._plan: Array = np.zeros(0)
        self._day: int | None = None
        self._sold_kwh = 0.0
        self._said: dict[str, float] = {}

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`bess.simulation.demand.DemandSource`."""
        held_kwh, size_kwh = self._store.held_kwh(now.state), self._store.size_kwh(now.state)
        if self._budget is not None:
            answered_kw = max(0.0, self._said.get("response_kw", 0.0))
            self._budget.advance(step, now.state.soc, now.delivered_kw, answered_kw)
        capacity_kw = float(self._reserve.capacity_kw[step])
        window, largest = (
            EnergyWindow.of(each, self._reserve.duration_min, size_kwh, self._store.one_way)
            for each in (capacity_kw, self._max_capacity_kw)
        )
        band = largest.narrowed(self._reserve.band)
        shift_kw = self._recharge.advance(step, held_kwh, band)
        traded_kw = self._traded(step, held_kwh, band)
        response_kw = self._response_kw.ahead(step, horizon)
        schedule_kw = padded(self._recharge.agreed_kw[: horizon - 1], horizon - 1)
        schedule_kw = np.concatenate([[shift_kw], schedule_kw]) + padded(traded_kw[:horizon], horizon)
        free_kw = max(0.0, float(now.limit_kw.sum()) - abs(schedule_kw[0]))
        self._said = {
            "response_kw": float(response_kw[0]),
            "schedule_kw": float(schedule_kw[0]),
            "capacity_kw": capacity_kw,
            "capacity_able_kw": min(free_kw, window.sustainable_kw(capacity_kw, held_kwh, size_kwh)),
            "soc_low": self._store.soc_at(now.state, window.low_kwh),
            "soc_high": self._store.soc_at(now.state, window.high_kwh),
        }
        demand_kw = padded(response_kw, horizon) + schedule_kw
        if self._budget is None:
            return demand_kw
        allowed_kw = self._budget.limited(demand_kw, self._store.smallest_kwh(now.state))
        if allowed_kw[0] != demand_kw[0]:
            self._said["capacity_able_kw"] = 0.0
        self._said |= self._budget.recorded()
        return allowed_kw

    def _traded(self, step: int, held_kwh: float, band: EnergyWindow) -> Array:
        """Return the planned trade of this step and the next ones."""
        if self._trade is None:
            return np.zeros(0)
        day = int(self._trade.days[step])
        if day != self._day:
            self._day, self._sold_kwh = day, 0.0
        self._plan = self._plan[1:]
        if self._trade.arbitrage.is_due(step):
            budget = self._budget
            price, left = (0.0, np.inf) if budget is None else (budget.price_eur_mwh, budget.left_kwh)
            self._plan = self._trade.arbitrage.plan(
                step, held_kwh - band.low_kwh, self._sold_kwh, use_eur_mwh=price, left_kwh=left
            )
        self._sold_kwh += max(0.0, float(self._plan[0])) * self._trade.arbitrage.dt_h / self._store.one_way
        return self._plan

    def planned(self, step: int) -> dict[str, float]:
        """Return response, schedule and reserve of the step of the last :meth:`ahead` call."""
        return self._said

    def memory(self) -> dict[str, Any]:
        """Return the scheduled recharge and trade."""
        return {
            "recharge": self._recharge.memory(),
            "plan": self._plan,
            "day": self._day,
            "sold_kwh": self._sold_kwh,
            "said": dict(self._said),
            "budget": None if self._budget is None else self._budget.memory(),
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """See :class:`bess.simulation.demand.DemandSource`."""
        self._recharge.recall(memory["recharge"])
        self._plan, self._day, self._sold_kwh = memory["plan"], memory["day"], memory["sold_kwh"]
        self._said = dict(memory["said"])
        if self._budget is not None:
            self._budget.recall(memory["budget"])
