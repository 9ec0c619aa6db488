"""What is asked of the plant in each step, and what the policy is told of the steps ahead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bess.ems import Arbitrage, Forecast

Array = NDArray[np.float64]


class DemandSource(Protocol):
    """Gives the demand of a step and its forecast; what it remembers is part of a checkpoint."""

    def ahead(self, step: int, horizon: int, energy_kwh: float) -> Array:
        """Demand [kW] of ``step`` (binding) and as foreseen for the next ones, shape ``(horizon,)``.

        Called once for each step, in order. ``energy_kwh`` is what the plant holds above its lower SOC
        limits.
        """

    def memory(self) -> dict[str, Any]:
        """What is carried from step to step."""

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""


class ProfileSource:
    """A series that is known; after its end nothing is asked."""

    def __init__(self, forecast: Forecast) -> None:
        self._forecast = forecast

    def ahead(self, step: int, horizon: int, energy_kwh: float) -> Array:
        """See :class:`DemandSource`."""
        return _padded(self._forecast.ahead(step, horizon), horizon)

    def memory(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Nothing to restore."""


class ArbitrageSource:
    """The plan of the arbitrage program, made anew whenever it is due."""

    def __init__(self, arbitrage: Arbitrage) -> None:
        self._arbitrage = arbitrage
        self._plan: Array = np.zeros(0)
        self._planned_at = 0
        self._day: int | None = None
        self._energy_kwh = 0.0
        self._discharged_kwh = 0.0

    def ahead(self, step: int, horizon: int, energy_kwh: float) -> Array:
        """See :class:`DemandSource`."""
        self._count_discharge(int(self._arbitrage.days[step]), energy_kwh)
        if self._arbitrage.is_due(step):
            self._plan = self._arbitrage.plan(step, energy_kwh, self._discharged_kwh)
            self._planned_at = step
        offset = step - self._planned_at
        return _padded(self._plan[offset : offset + horizon], horizon)

    def memory(self) -> dict[str, Any]:
        """The plan, and what counts against the cycle limit of the day."""
        return {
            "plan": self._plan,
            "planned_at": self._planned_at,
            "day": self._day,
            "energy_kwh": self._energy_kwh,
            "discharged_kwh": self._discharged_kwh,
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """See :class:`DemandSource`."""
        self._plan = memory["plan"]
        self._planned_at = memory["planned_at"]
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


def _padded(values: Array, horizon: int) -> Array:
    """Nothing is asked after the end of the series."""
    return np.concatenate([values, np.zeros(horizon - values.size)])
