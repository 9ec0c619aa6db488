"""Tables of the cells of a string, and their limits within a level of charge."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bess.arrays import Array
from bess.system.battery import Battery
from bess.system.parse import StringParameters

_Pick = Callable[..., Any]

CHARGE, DISCHARGE = 0, 1
"""Rows of the coefficients of both directions of power."""

_MIN_HEALTH = 0.2
"""Minimum capacity of a string in use, as a share of its initial capacity."""


class Level(NamedTuple):
    """Limits within a level of charge in one direction; fields as in :class:`RelaxedString`."""

    ratio: float
    ratio_against: float
    max_heat: float
    top_v: float
    """Maximum voltage [V]."""
    min_ohm: Array
    """Minimum resistance at each temperature [Ohm]."""


@dataclass(frozen=True)
class Cells:
    """Voltages and resistances of the cells of a string.

    Within a plant step both keep their values at its start, where the SOC may be outside the level.
    """

    battery: Battery
    ages: bool
    """Whether capacity may fall, and with it the energy at a given SOC."""
    soh_resistance: float
    soc: Array
    """SOC of the voltages."""
    highest_v: tuple[Array, Array]
    lowest_v: tuple[Array, Array]
    """Limits of the voltage over temperature [V], in charge and discharge."""
    capacity_ah: float
    max_kw: float
    """Maximum power of the cells."""
    soc_per_a: float
    """Maximum change of SOC in a plant step, per ampere."""

    @classmethod
    def of(
        cls, string: StringParameters, plant_step_s: float, soh_capacity: float, soh_resistance: float
    ) -> Cells:
        """Take the tables of a string."""
        battery, inverter = string.battery, string.inverter
        charge, discharge = (
            np.array(rows) * battery.cells_series for rows in (battery.ocv_v.charge, battery.ocv_v.discharge)
        )
        ages = string.wear.cell_model is not None
        capacity_ah = battery.cell_capacity_ah * battery.cells_parallel * soh_capacity
        # An aged string has less capacity, so its SOC changes more per step.
        min_ah = capacity_ah * (_MIN_HEALTH if ages else 1.0)
        return cls(
            battery=battery,
            ages=ages,
            soh_resistance=soh_resistance,
            soc=np.array(battery.ocv_v.soc),
            highest_v=(charge.max(axis=0), discharge.max(axis=0)),
            lowest_v=(charge.min(axis=0), discharge.min(axis=0)),
            capacity_ah=capacity_ah,
            max_kw=inverter.nominal_kw * (1.0 + max(*inverter.loss_charge, *inverter.loss_discharge)),
            soc_per_a=plant_step_s / 3600.0 / min_ah,
        )

    @property
    def min_v(self) -> Array:
        """Minimum voltage in both directions [V]."""
        return np.minimum(*self.lowest_v)

    @property
    def window(self) -> tuple[float, float]:
        """Limits of the SOC."""
        return self.battery.soc_min, self.battery.soc_max

    @property
    def knots(self) -> Array:
        """SOC between which the tables are linear."""
        switch = self.battery.low_soc_switch
        return np.unique([*self.soc, *self.battery.resistance_axes[0], switch, np.nextafter(switch, 0.0)])

    def current_a(self, low: float, max_ohm: float) -> float:
        """Maximum current [A] above a SOC and below a resistance."""
        volt = float(np.interp(low, self.soc, self.min_v))
        root = math.sqrt(max(volt**2 - 4e3 * max_ohm * self.max_kw, 0.0))
        return 2e3 * self.max_kw / (volt + root)

    def max_ohm(self, direction: int, low: float, high: float, temperature_c: Array) -> float:
        """Maximum resistance within an interval of SOC."""
        ohm = _ohm(self.battery, direction, between(self.knots, low, high), temperature_c, np.max)
        return float(ohm.max()) * self.soh_resistance

    def max_heat_kw(self, charge_kw: float, temperature_c: Array) -> float:
        """Maximum heat of a charging power [kW]."""
        max_ohm = self.max_ohm(CHARGE, *self.window, temperature_c)
        return 1e-3 * max_ohm * (2e3 * charge_kw / float(self.min_v.min())) ** 2

    def level(self, direction: int, low: float, high: float, temperature_c: Array) -> Level:
        """Return the limits between two SOC."""
        soc_min, soc_max = self.window
        furthest = self.current_a(soc_min, np.inf) * self.soc_per_a
        lowest, highest = max(low - furthest, soc_min), min(high + furthest, soc_max)
        max_ohm = self.max_ohm(direction, lowest, highest, temperature_c)
        current_a = self.current_a(lowest, max_ohm)
        travel = furthest if self.ages else current_a * self.soc_per_a
        charging = direction == CHARGE
        # SOC at the start of a plant step, relative to that within the step.
        shift = -travel if charging else travel
        began = between(self.knots, max(low + min(shift, 0.0), soc_min), min(high + max(shift, 0.0), soc_max))
        within = between(np.concatenate([self.knots, self.knots - shift]), low, high)
        stored_v = np.interp(within, self.soc, self.highest_v[DISCHARGE])
        highest_v, lowest_v = self.highest_v[direction], self.lowest_v[direction]
        favourable_v, adverse_v = (lowest_v, highest_v) if charging else (highest_v, lowest_v)
        best, worst = (np.max, np.min) if charging else (np.min, np.max)
        return Level(
            ratio=best(stored_v / np.interp(within + shift, self.soc, favourable_v)),
            ratio_against=worst(stored_v / np.interp(within, self.soc, adverse_v)),
            max_heat=max_ohm * current_a / float(np.interp(lowest, self.soc, self.min_v)),
            top_v=float(np.interp(began, self.soc, highest_v).max()),
            min_ohm=_ohm(self.battery, direction, began, temperature_c, np.min) * self.soh_resistance,
        )


def between(knots: Array, low: float, high: float) -> Array:
    """Ends and inner knots of an interval; between them a ratio of straight lines is monotone."""
    return np.unique([low, *knots[(knots > low) & (knots < high)], high])


def _ohm(battery: Battery, direction: int, soc: Array, temperature_c: Array, pick: _Pick) -> Array:
    """Minimum (or maximum) resistance of a string [Ohm] over SOC and C-rate at each temperature.

    Between these temperatures the minimum lies above the straight line, because it is linear for each SOC.
    """
    ohm = 1e-3 * battery.r_scale * battery.cells_series / battery.cells_parallel
    table = battery.resistance_table
    if table is not None:
        blocks = np.array(table.discharge_mohm if direction == DISCHARGE else table.charge_mohm)
        rows = [[pick(np.interp(soc, table.soc, row)) for row in rows] for rows in blocks]
        return ohm * np.interp(temperature_c, table.temperature_c, pick(np.array(rows), axis=0))
    over_t, over_soc = battery.resistance_temperature, battery.resistance_soc
    assert over_t is not None and over_soc is not None
    at = np.interp(temperature_c, over_t.temperature_c, over_t.resistance_mohm)
    at_25 = np.interp(25.0, over_t.temperature_c, over_t.resistance_mohm)
    low = soc < battery.low_soc_switch
    factor = np.where(low, np.interp(soc, over_soc.soc, over_soc.resistance_mohm) / at_25, 1.0)
    return np.asarray(ohm * at * pick(factor))
