"""Section ``[battery]`` of a system file: one string's battery, with electrical tables at cell level."""

import math
from itertools import pairwise
from typing import ClassVar, Self

import numpy as np
from pydantic import field_validator, model_validator

from bess.arrays import Array
from bess.system.quantities import (
    CellCapacity,
    CellMass,
    CellResistance,
    CellVoltage,
    Count,
    EntropyCoefficient,
    Fraction,
    RateAxis,
    Ratio,
    SocAxis,
    TemperatureAxis,
)
from bess.system.section import Section, Table

Resistances = tuple[CellResistance, ...]
Voltages = tuple[CellVoltage, ...] | tuple[tuple[CellVoltage, ...], ...]


class OcvTable(Table):
    """Open-circuit voltage of one cell [V] over SOC and, optionally, temperature [degC].

    Without ``temperature_c`` each direction is one list over SOC; with it, one such list for each
    temperature. The gap between ``charge`` and ``discharge`` is the hysteresis.
    """

    axes: ClassVar = {"charge": ("temperature_c", "soc"), "discharge": ("temperature_c", "soc")}

    soc: SocAxis
    temperature_c: TemperatureAxis = (25.0,)
    charge: tuple[tuple[CellVoltage, ...], ...]
    discharge: tuple[tuple[CellVoltage, ...], ...]

    @field_validator("charge", "discharge", mode="before", json_schema_input_type=Voltages)
    @classmethod
    def _one_row(cls, value: object) -> object:
        """Accept a flat list as a table for one temperature."""
        if isinstance(value, list | tuple) and value and not isinstance(value[0], list | tuple):
            return (tuple(value),)
        return value

    @property
    def discharge_v(self) -> Array:
        """Voltage over SOC of discharge at the temperature nearest to 25 degC."""
        return np.array(self.discharge[int(np.argmin(np.abs(np.array(self.temperature_c) - 25.0)))])

    @property
    def mean_v(self) -> float:
        """Mean of :attr:`discharge_v` over SOC."""
        return float(np.trapezoid(self.discharge_v, self.soc) / (self.soc[-1] - self.soc[0]))

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("charge", "discharge"):
            for row in getattr(self, name):
                for index, (low, high) in enumerate(pairwise(row)):
                    if high < low:
                        raise ValueError(
                            f"{name} must not fall with SOC, but falls from {low:g} V at soc "
                            f"{self.soc[index]:g} to {high:g} V at soc {self.soc[index + 1]:g}"
                        )
        for charge_row, discharge_row in zip(self.charge, self.discharge, strict=True):
            for soc, charge, discharge in zip(self.soc, charge_row, discharge_row, strict=True):
                if charge < discharge:
                    raise ValueError(
                        f"charge OCV {charge:g} V is below discharge OCV {discharge:g} V at soc {soc:g}; "
                        "hysteresis cannot give energy back"
                    )
        return self


class ResistanceOverTemperature(Table):
    """Cell resistance [mOhm] over temperature [degC], ``f_T``; clamped outside."""

    axes: ClassVar = {"resistance_mohm": ("temperature_c",)}

    temperature_c: TemperatureAxis
    resistance_mohm: Resistances


class ResistanceOverSoc(Table):
    """Cell resistance [mOhm] over SOC, ``f_soc``; used below ``low_soc_switch`` only."""

    axes: ClassVar = {"resistance_mohm": ("soc",)}

    soc: SocAxis
    resistance_mohm: Resistances


class EntropyTable(Table):
    """Entropy coefficient ``dU/dT`` of one cell [mV/K] over SOC; clamped outside."""

    axes: ClassVar = {"du_dt_mv_k": ("soc",)}

    soc: SocAxis
    du_dt_mv_k: tuple[EntropyCoefficient, ...]


class ResistanceTable(Table):
    """Measured cell resistance [mOhm] by direction, indexed ``[c_rate][temperature][soc]``.

    The plant interpolates at the actual C-rate; the controller, without inner iterations, at
    ``control_c_rate``.
    """

    axes: ClassVar = {
        "charge_mohm": ("c_rate", "temperature_c", "soc"),
        "discharge_mohm": ("c_rate", "temperature_c", "soc"),
    }

    soc: SocAxis
    temperature_c: TemperatureAxis
    c_rate: RateAxis
    control_c_rate: Ratio
    charge_mohm: tuple[tuple[Resistances, ...], ...]
    discharge_mohm: tuple[tuple[Resistances, ...], ...]


class Battery(Section):
    """Battery of one string; electrical tables are at cell level."""

    cells_series: Count
    cells_parallel: Count
    cell_capacity_ah: CellCapacity
    cell_mass_kg: CellMass
    soc_min: Fraction = 0.0
    soc_max: Fraction = 1.0
    cell_voltage_min_v: CellVoltage | None = None
    cell_voltage_max_v: CellVoltage | None = None
    low_soc_switch: Fraction = 0.10
    r_scale: Ratio = 1.0
    hysteresis_heat: bool = False
    ocv_v: OcvTable
    resistance_temperature: ResistanceOverTemperature | None = None
    resistance_soc: ResistanceOverSoc | None = None
    resistance_table: ResistanceTable | None = None
    entropy: EntropyTable | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.soc_min >= self.soc_max:
            raise ValueError(f"soc_min {self.soc_min:g} must be below soc_max {self.soc_max:g}")
        low, high = self.ocv_v.soc[0], self.ocv_v.soc[-1]
        if self.soc_min < low or self.soc_max > high:
            raise ValueError(
                f"the SOC window [{self.soc_min:g}, {self.soc_max:g}] leaves the OCV table "
                f"[{low:g}, {high:g}], which is never extrapolated"
            )
        self._check_voltages()
        switched = (self.resistance_temperature is not None, self.resistance_soc is not None)
        if (switched, self.resistance_table is None) not in (((True, True), True), ((False, False), False)):
            raise ValueError(
                "give either resistance_temperature together with resistance_soc, or resistance_table"
            )
        return self

    @property
    def resistance_axes(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """SOC and temperatures [degC] between which resistance is linear; it is constant outside."""
        over_soc = self.resistance_table or self.resistance_soc
        over_t = self.resistance_table or self.resistance_temperature
        assert over_soc is not None and over_t is not None
        return over_soc.soc, over_t.temperature_c

    @property
    def voltage_min_v(self) -> float:
        """Lowest voltage of the string in discharge [V], 0 without a limit."""
        return (self.cell_voltage_min_v or 0.0) * self.cells_series

    @property
    def voltage_max_v(self) -> float:
        """Highest voltage of the string in charge [V], infinite without a limit."""
        return math.inf if self.cell_voltage_max_v is None else self.cell_voltage_max_v * self.cells_series

    def _check_voltages(self) -> None:
        """Reject voltage limits that exclude the open-circuit voltage at every SOC."""
        lowest, highest = (
            float(np.interp(soc, self.ocv_v.soc, rows[0]))
            for soc, rows in ((self.soc_min, self.ocv_v.charge), (self.soc_max, self.ocv_v.discharge))
        )
        least, most = self.cell_voltage_min_v, self.cell_voltage_max_v
        if most is not None and most <= lowest:
            raise ValueError(
                f"cell_voltage_max_v {most:g} V must be above the "
                f"open-circuit voltage at soc_min, {lowest:g} V"
            )
        if least is not None and least >= highest:
            raise ValueError(
                f"cell_voltage_min_v {least:g} V must be below the "
                f"open-circuit voltage at soc_max, {highest:g} V"
            )
