"""What services ask of the plant in each step, from its measured state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bess.ems import Arbitrage, Forecast, Level, Recharge, Store, Window
from bess.numbers import Array
from bess.simulation.demand import Now, padded


class ExpectedZero:
    """Forecast of a droop response: that of this step is measured, that of later ones nothing in the mean.

    Parameters
    ----------
    values : ndarray, shape (n_steps,)
        The response that comes true.
    """

    def __init__(self, values: Array) -> None:
        self._values = values

    def ahead(self, step: int, horizon: int) -> Array:
        """See :class:`bess.ems.Forecast`."""
        seen = np.zeros(min(horizon, self._values.size - step))
        seen[0] = self._values[step]
        return seen


class MeterSource:
    """A store behind a meter keeps what is drawn from the grid at a level (:class:`bess.ems.Level`)."""

    follows_store = True

    def __init__(self, net_kw: Forecast, level: Level, store: Store, ready_soc: float) -> None:
        self._net_kw, self._level, self._store, self._ready_soc = net_kw, level, store, ready_soc

    def ahead(self, step: int, horizon: int, now: Now) -> Array:
        """See :class:`bess.simulation.demand.DemandSource`."""
        state = now.state
        self._store.count(state, now.delivered_kw * self._level.dt_h)
        level = replace(
            self._level,
            one_way=self._store.one_way,
            power_kw=min(self._level.power_kw, float(now.limit_kw.sum())),
            full_kwh=self._store.size_kwh(state, self._ready_soc),
        )
        return padded(
            level.demand_kw(self._net_kw.ahead(step, horizon), self._store.held_kwh(state)), horizon
        )

    def planned(self, step: int) -> dict[str, float]:
        """Nothing beside what is asked."""
        return {}

    def memory(self) -> dict[str, Any]:
        """What was measured of the store."""
        return self._store.memory()

    def recall(self, memory: Mapping[str, Any]) -> None:
        """See :class:`bess.simulation.demand.DemandSource`."""
        self._store.recall(memory)


@dataclass(frozen=True)
class Reserve:
    """What was sold.

    Attributes
    ----------
    capacity_kw : float
        Symmetric reserve.
    duration_min : float
        For which all of it must be in store.
    band : float
        Share of the required window in which nothing is recharged.
    """

    capacity_kw: float
    duration_min: float
    band: float


@dataclass
class Trade:
    """Plans over prices with the power and energy that the reserve leaves."""

    arbitrage: Arbitrage
    days: NDArray[np.int64]


class ReserveSource:
    """Droop response, recharge by schedule, and trade beside it if there is one."""

    follows_store = False

    def __init__(
        self, response_kw: Forecast, reserve: Reserve, recharge: Recharge, store: Store, trade: Trade | None
    ) -> None:
        self._response_kw, self._reserve, self._store = response_kw, reserve, store
        self._recharge, self._trade = recharge, trade
        self._plan: Array = np.zeros(0)
        self._day: int | None = None
        self._sold_kwh = 0.0
        self._said: dict[str, float] = {}

    def ahead(self, step: int, horizon: int, now: Now) -> Array:
        """See :class:`bess.simulation.demand.DemandSource`."""
        held_kwh, size_kwh = self._store.held_kwh(now.state), self._store.size_kwh(now.state)
        capacity_kw = self._reserve.capacity_kw
        window = Window.of(capacity_kw, self._reserve.duration_min, size_kwh, self._store.one_way)
        band = window.narrowed(self._reserve.band)
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
            "capacity_able_kw": min(free_kw, window.able_kw(capacity_kw, held_kwh, size_kwh)),
            "soc_low": self._store.soc_at(now.state, window.low_kwh),
            "soc_high": self._store.soc_at(now.state, window.high_kwh),
        }
        return padded(response_kw, horizon) + schedule_kw

    def _traded(self, step: int, held_kwh: float, band: Window) -> Array:
        """What is traded in this step and those to come, as planned."""
        if self._trade is None:
            return np.zeros(0)
        day = int(self._trade.days[step])
        if day != self._day:
            self._day, self._sold_kwh = day, 0.0
        self._plan = self._plan[1:]
        if self._trade.arbitrage.is_due(step):
            self._plan = self._trade.arbitrage.plan(step, held_kwh - band.low_kwh, self._sold_kwh)
        self._sold_kwh += max(0.0, float(self._plan[0])) * self._trade.arbitrage.dt_h / self._store.one_way
        return self._plan

    def planned(self, step: int) -> dict[str, float]:
        """Response, schedule and reserve of the step that :meth:`ahead` was called for."""
        return self._said

    def memory(self) -> dict[str, Any]:
        """What is agreed on and traded."""
        return {
            "recharge": self._recharge.memory(),
            "plan": self._plan,
            "day": self._day,
            "sold_kwh": self._sold_kwh,
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """See :class:`bess.simulation.demand.DemandSource`."""
        self._recharge.recall(memory["recharge"])
        self._plan, self._day, self._sold_kwh = memory["plan"], memory["day"], memory["sold_kwh"]
