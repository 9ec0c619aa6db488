"""Frequency containment reserve: droop response, energy reservoir and recharging.

Plant power, positive = discharge; the reserve is symmetric.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.errors import InputError

_MINUTES_PER_HOUR = 60.0


def droop_response(
    frequency_mhz: npt.ArrayLike, droop_mhz: float = 200.0, dead_band_mhz: float = 10.0
) -> Array:
    """Return the activated share of the reserve for a frequency deviation, from -1 to 1.

    The share is 1 from ``droop_mhz`` on, 0 within ``dead_band_mhz``, and proportional to the whole deviation
    in between, as in [1]_. Above the nominal frequency the plant charges (negative).

    Parameters
    ----------
    frequency_mhz : array_like
        Deviation from nominal [mHz].
    droop_mhz, dead_band_mhz : float
        ``0 <= dead_band_mhz < droop_mhz``.

    Raises
    ------
    InputError
        The dead band is negative or not below the droop.

    References
    ----------
    .. [1] Commission Regulation (EU) 2017/1485 (system operation guideline), Annex V and Article 154.
    """
    if not 0.0 <= dead_band_mhz < droop_mhz:
        raise InputError(
            f"demand.dead_band_mhz = {dead_band_mhz:g} mHz must be at least 0 and below "
            f"demand.droop_mhz = {droop_mhz:g} mHz"
        )
    deviation = np.asarray(frequency_mhz, dtype=np.float64)
    share: Array = -np.clip(deviation / droop_mhz, -1.0, 1.0)
    return np.where(np.abs(deviation) <= dead_band_mhz, 0.0, share)


@dataclass(frozen=True)
class EnergyWindow:
    """Range for the stored energy, in kWh above the lower SOC limits.

    Attributes
    ----------
    low_kwh, high_kwh : float
        Between them the whole reserve can be delivered for the required duration in either direction.
    """

    low_kwh: float
    high_kwh: float

    @classmethod
    def of(
        cls, capacity_kw: float, duration_min: float, capacity_kwh: float, one_way_efficiency: float
    ) -> "EnergyWindow":
        """Return the window of a store of this capacity, with the efficiency of each direction."""
        energy_kwh = capacity_kw * duration_min / _MINUTES_PER_HOUR
        return cls(energy_kwh / one_way_efficiency, capacity_kwh - energy_kwh * one_way_efficiency)

    def narrowed(self, share: float) -> "EnergyWindow":
        """Return the central ``share`` of the window."""
        middle, half = (self.low_kwh + self.high_kwh) / 2.0, (self.high_kwh - self.low_kwh) / 2.0
        return EnergyWindow(middle - share * half, middle + share * half)

    def sustainable_kw(self, capacity_kw: float, stored_kwh: float, capacity_kwh: float) -> float:
        """Return the reserve that ``stored_kwh`` sustains for the required duration in both directions."""
        if self.high_kwh >= capacity_kwh:  # no reserve, or none that takes energy
            return capacity_kw
        below, above = stored_kwh / self.low_kwh, (capacity_kwh - stored_kwh) / (capacity_kwh - self.high_kwh)
        return capacity_kw * float(np.clip(min(below, above), 0.0, 1.0))


@dataclass
class RechargeScheduler(Checkpointed):
    """Set-point shifts that restore the stored energy, scheduled in advance.

    The shift of a slot is scheduled ``lead_steps`` before the slot begins, at the start of another slot. With
    a mean response of zero and at most ``power_kw``, it returns the energy to the edge of the required band
    within the slot.

    Parameters
    ----------
    power_kw : float
        Maximum shift.
    lead_steps, slot_steps : int
        Control steps of the lead time and of a slot.
    dt_h : float
        Control step [h].
    one_way_efficiency : float
        Efficiency of each direction.
    scheduled_kw : ndarray
        Scheduled shifts, from the present step on.
    """

    _carried: ClassVar = ("scheduled_kw",)

    power_kw: float
    lead_steps: int
    slot_steps: int
    dt_h: float
    one_way_efficiency: float
    scheduled_kw: Array = field(default_factory=lambda: np.zeros(0))

    def advance(
        self, step: int, stored_kwh: float, band: EnergyWindow, available_kw: float = np.inf
    ) -> float:
        """Schedule the next slot if one is due, and return the shift of ``step`` [kW, positive = discharge].

        Called once for each step, in order. ``available_kw`` is the power of the inverters in service.
        """
        if step == 0:
            self.scheduled_kw = np.zeros(self.lead_steps)
        if step % self.slot_steps == 0:
            self.scheduled_kw = np.concatenate(
                [self.scheduled_kw, self._slot(stored_kwh, band, available_kw)]
            )
        shift, self.scheduled_kw = float(self.scheduled_kw[0]), self.scheduled_kw[1:]
        return shift

    def _slot(self, stored_kwh: float, band: EnergyWindow, available_kw: float) -> Array:
        coming = self.scheduled_kw * self.dt_h
        one_way = self.one_way_efficiency
        drawn = np.where(coming > 0.0, coming / one_way, coming * one_way).sum()
        expected = stored_kwh - drawn
        slot_h = self.slot_steps * self.dt_h
        surplus, lacking = max(0.0, expected - band.high_kwh), max(0.0, band.low_kwh - expected)
        shift = (surplus * one_way - lacking / one_way) / slot_h
        max_kw = min(self.power_kw, available_kw)
        return np.full(self.slot_steps, np.clip(shift, -max_kw, max_kw))
