"""Per-unit constants of the plant for the relaxation; its other coefficients come from the core
(:meth:`bess._core.ControlHorizon.relaxed`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.control.problem import SplitProblem
from bess.control.split.relaxation.equations import LOSSES
from bess.system import State, System
from bess.units import SECONDS_PER_HOUR, WATTS_PER_KW

THETA_ZERO_C = 25.0
THETA_UNIT_K = 10.0


@dataclass(frozen=True)
class PlantConstants:
    """Constants of a plant and a step length for the relaxation; arrays over strings, powers in kW."""

    nominal_kw: Array
    inverter_kw: Array
    battery_kw: Array
    retained: Array
    kelvin_per_kw: Array
    same: NDArray[np.bool_]
    """Whether strings ``m`` and ``m + 1`` are identical, shape ``(n_strings - 1,)``."""

    @classmethod
    def of(cls, system: System, dt_h: float) -> PlantConstants:
        """Collect the constants."""
        strings = system.strings
        _, battery_kw = system.control_at(system.initial_state()).nominal_loss_kw()
        largest = np.array([max(*s.inverter.loss_charge, *s.inverter.loss_discharge) for s in strings])
        k1 = np.array([s.thermal.lumped.k1_k_per_j for s in strings])
        k2 = np.array([s.thermal.lumped.k2_per_s for s in strings])
        seconds = dt_h * SECONDS_PER_HOUR
        return cls(
            nominal_kw=system.nominal_kw,
            inverter_kw=largest * system.nominal_kw,
            battery_kw=battery_kw,
            retained=1.0 - k2 * seconds,
            kelvin_per_kw=k1 * seconds * WATTS_PER_KW,
            same=np.diff(system.kinds) == 0,
        )

    def at(self, state: State) -> PlantConstants:
        """Return the constants with ``same`` restricted to strings in equal states."""
        same = self.same
        for values in (state.soc, state.temperature_c, state.soh_capacity, state.soh_resistance):
            same = same & (np.diff(values) == 0.0)
        return replace(self, same=same)

    @property
    def scale_kw(self) -> Array:
        """Unit of each cost variable (a, d, w, h) [kW], shape ``(n_strings, 4)``."""
        return np.stack([self.nominal_kw, self.nominal_kw, self.inverter_kw, self.battery_kw], axis=1)

    def physics(self, problem: SplitProblem) -> dict[str, Array]:
        """Values of the parameters common to all nodes, except cuts, caps and costs."""
        shape = problem.limit_kw.shape
        base_kw = self.nominal_kw.mean()
        nominal, retained = self.nominal_kw[:, None], self.retained[:, None]
        sign = np.broadcast_to(np.where(problem.demand_kw >= 0.0, 1.0, -1.0), shape)
        return {
            "share": self.nominal_kw / base_kw,
            "demand": np.abs(problem.demand_kw) / base_kw,
            "sign": sign,
            "inverter_share": sign * self.inverter_kw[:, None] / nominal,
            "battery_share": sign * self.battery_kw[:, None] / nominal,
            "retained": np.broadcast_to(retained, shape),
            "heating": np.broadcast_to((self.kelvin_per_kw * self.battery_kw)[:, None] / THETA_UNIT_K, shape),
            "air": (1.0 - retained) * (problem.ambient_c - THETA_ZERO_C) / THETA_UNIT_K,
        }


def costs(prefix: str, cost: Array) -> dict[str, Array]:
    """Parameters of a cost row from costs ``(n_strings, 4)`` in the units of the variables."""
    return {f"{prefix}_{name}": cost[:, i] for i, name in enumerate(LOSSES)}
