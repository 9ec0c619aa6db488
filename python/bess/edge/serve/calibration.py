"""A calibration: one string is charged to full while the others carry the load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bess.edge.serve.measurement_validator import ValidState
from bess.edge.serve.soc_limits import PowerCapability, SocLimits
from bess.errors import InputError
from bess.system import System

QUARTER: Final = 0.25
"""Share of nominal power at which a string is calibrated unless the settings say otherwise."""
_FULL: Final = 0.005
"""State of charge below the target that counts as the target."""


@dataclass(frozen=True)
class Calibration:
    """One string that is being charged to ``target_soc``."""

    string: int
    target_soc: float

    def check(self, reserves: SocLimits) -> None:
        """Refuse what cannot be done.

        Raises
        ------
        InputError
            If there is no such string, no other one, or the target is outside its window.
        """
        n = reserves.full.size
        if not 0 <= self.string < n:
            raise InputError(f"string = {self.string}: the plant has strings 0 to {n - 1}")
        low, high = reserves.floor[self.string], reserves.full[self.string]
        if not low < self.target_soc <= high:
            raise InputError(
                f"target_soc = {self.target_soc:g}: must be in ({low:g}, {high:g}] of string {self.string}"
            )
        if n == 1:
            raise InputError("calibration: there is no other string to carry the load")

    def is_done(self, trusted: ValidState) -> bool:
        """Whether the string is full, whichever of its values is true."""
        return bool(trusted.soc_low[self.string] >= self.target_soc - _FULL)

    def charge_kw(
        self,
        system: System,
        trusted: ValidState,
        able: PowerCapability,
        demand_kw: float,
        most_kw: float | None,
        dt_h: float,
    ) -> float:
        """Magnitude at which it is charged over the next ``dt_h`` hours.

        The others carry the load and the charge; where they cannot, the charge is less. ``most_kw`` is the
        setting, None for :data:`QUARTER` of nominal power.
        """
        i = self.string
        wanted_kw = most_kw or QUARTER * float(system.nominal_kw[i])
        room_kwh = float((self.target_soc - trusted.soc_high[i]) * system.nominal_energy_kwh[i])
        others = trusted.in_service & (np.arange(system.n_strings) != i)
        spare_kw = float(able.discharge_kw[others].sum()) - demand_kw
        return max(0.0, min(wanted_kw, float(trusted.charge_kw[i]), max(room_kwh, 0.0) / dt_h, spare_kw))
