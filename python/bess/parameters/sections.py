"""Sections of a system file, one class each, as in ``data/systems/reference.toml``.

Values are at cell level where the file says so; string values are made once, in the Rust core. Every class refuses
unknown keys, NaN and infinity.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Temperature = Annotated[float, Field(ge=-60.0, le=150.0)]
Axis = Annotated[tuple[float, ...], Field(min_length=1)]
SocAxis = Annotated[tuple[Fraction, ...], Field(min_length=2)]
TemperatureAxis = Annotated[tuple[Temperature, ...], Field(min_length=1)]
Resistances = tuple[Positive, ...]


class Section(BaseModel):
    """Base of all sections: frozen, unknown keys and NaN refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return ``values`` if they strictly ascend."""
    for first, second in pairwise(values):
        if second <= first:
            raise ValueError(f"knots must ascend, but {second:g} follows {first:g}")
    return values


def _same_length(axis_name: str, axis: tuple[float, ...], name: str, values: tuple[object, ...]) -> None:
    if len(values) != len(axis):
        raise ValueError(f"{name} has {len(values)} values, {axis_name} has {len(axis)}; give one per knot")


class OcvTable(Section):
    """Open-circuit voltage of one cell [V] over SOC and, optionally, temperature [degC].

    Without ``temperature_c`` each direction is one list over SOC; with it, one such list for each temperature.
    """

    soc: SocAxis
    temperature_c: TemperatureAxis = (25.0,)
    charge: tuple[tuple[Positive, ...], ...]
    discharge: tuple[tuple[Positive, ...], ...]

    _ascend = field_validator("soc", "temperature_c")(ascending)

    @field_validator("charge", "discharge", mode="before")
    @classmethod
    def _one_row(cls, value: object) -> object:
        """A flat list is a table of one temperature."""
        if isinstance(value, list | tuple) and value and not isinstance(value[0], list | tuple):
            return (tuple(value),)
        return value

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("charge", "discharge"):
            rows = getattr(self, name)
            _same_length("temperature_c", self.temperature_c, name, rows)
            for row in rows:
                _same_length("soc", self.soc, name, row)
                for index, (low, high) in enumerate(pairwise(row)):
                    if high < low:
                        raise ValueError(
                            f"{name} must not fall with SOC, but falls from {low:g} V at soc {self.soc[index]:g} "
                            f"to {high:g} V at soc {self.soc[index + 1]:g}"
                        )
        for charge_row, discharge_row in zip(self.charge, self.discharge, strict=True):
            for soc, charge, discharge in zip(self.soc, charge_row, discharge_row, strict=True):
                if charge < discharge:
                    raise ValueError(
                        f"charge OCV {charge:g} V is below discharge OCV {discharge:g} V at soc {soc:g}; "
                        "hysteresis cannot give energy back"
                    )
        return self


class ResistanceOverTemperature(Section):
    """Cell resistance [mOhm] over temperature [degC], ``f_T``; clamped outside."""

    temperature_c: TemperatureAxis
    resistance_mohm: Resistances

    _ascend = field_validator("temperature_c")(ascending)

    @model_validator(mode="after")
    def _check(self) -> Self:
        _same_length("temperature_c", self.temperature_c, "resistance_mohm", self.resistance_mohm)
        return self


class ResistanceOverSoc(Section):
    """Cell resistance [mOhm] over SOC, ``f_soc``; used below ``low_soc_switch`` only."""

    soc: SocAxis
    resistance_mohm: Resistances

    _ascend = field_validator("soc")(ascending)

    @model_validator(mode="after")
    def _check(self) -> Self:
        _same_length("soc", self.soc, "resistance_mohm", self.resistance_mohm)
        return self


class ResistanceTable(Section):
    """Measured cell resistance [mOhm], indexed ``[c_rate][temperature][soc]``, each direction on its own.

    The plant reads it at the C-rate that flows. The controller has no inner iteration and reads it at
    ``control_c_rate``.
    """

    soc: SocAxis
    temperature_c: TemperatureAxis
    c_rate: Axis
    control_c_rate: Positive
    charge_mohm: tuple[tuple[Resistances, ...], ...]
    discharge_mohm: tuple[tuple[Resistances, ...], ...]

    _ascend = field_validator("soc", "temperature_c", "c_rate")(ascending)

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("charge_mohm", "discharge_mohm"):
            blocks = getattr(self, name)
            _same_length("c_rate", self.c_rate, name, blocks)
            for rows in blocks:
                _same_length("temperature_c", self.temperature_c, name, rows)
                for row in rows:
                    _same_length("soc", self.soc, name, row)
        return self


class Battery(Section):
    """Battery of one string; electrical tables are at cell level."""

    cells_series: Annotated[int, Field(ge=1)]
    cells_parallel: Annotated[int, Field(ge=1)]
    cell_capacity_ah: Positive
    cell_mass_kg: Positive
    soc_min: Fraction = 0.0
    soc_max: Fraction = 1.0
    availability_epsilon: Annotated[float, Field(ge=0.0, le=0.05)] = 1e-3
    low_soc_switch: Fraction = 0.10
    r_scale: Positive = 1.0
    ocv_v: OcvTable
    resistance_temperature: ResistanceOverTemperature | None = None
    resistance_soc: ResistanceOverSoc | None = None
    resistance_table: ResistanceTable | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.soc_min >= self.soc_max:
            raise ValueError(f"soc_min {self.soc_min:g} must be below soc_max {self.soc_max:g}")
        low, high = self.ocv_v.soc[0], self.ocv_v.soc[-1]
        if self.soc_min < low or self.soc_max > high:
            raise ValueError(
                f"the SOC window [{self.soc_min:g}, {self.soc_max:g}] leaves the OCV table [{low:g}, {high:g}], "
                "which is never extrapolated"
            )
        switched = (self.resistance_temperature is not None, self.resistance_soc is not None)
        if (switched, self.resistance_table is None) not in (((True, True), True), ((False, False), False)):
            raise ValueError(
                "give either resistance_temperature together with resistance_soc, or resistance_table"
            )
        return self


class Inverter(Section):
    """Inverter of one string: losses as fractions of nominal AC power over delivered AC power / nominal.

    ``load`` starts at 0 (the no-load loss of an inverter that is on) and ends at 1.
    """

    nominal_kw: Positive
    load: Annotated[tuple[Fraction, ...], Field(min_length=2)]
    loss_charge: tuple[Annotated[float, Field(ge=0.0, lt=1.0)], ...]
    loss_discharge: tuple[Annotated[float, Field(ge=0.0, lt=1.0)], ...]
    off_loss: Annotated[float, Field(ge=0.0, lt=0.1)] = 0.0

    _ascend = field_validator("load")(ascending)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.load[0] != 0.0 or self.load[-1] != 1.0:
            raise ValueError(f"load must run from 0 to 1, not from {self.load[0]:g} to {self.load[-1]:g}")
        for name in ("loss_charge", "loss_discharge"):
            _same_length("load", self.load, name, getattr(self, name))
        return self


class Derating(Section):
    """Temperature derating: the factor table and the gains of the PI law."""

    start_c: Temperature
    stop_c: Temperature
    kp_per_k: NonNegative
    ki_per_k_step: NonNegative
    temperature_c: TemperatureAxis
    factor: tuple[Fraction, ...]

    _ascend = field_validator("temperature_c")(ascending)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.start_c >= self.stop_c:
            raise ValueError(f"start_c {self.start_c:g} degC must be below stop_c {self.stop_c:g} degC")
        _same_length("temperature_c", self.temperature_c, "factor", self.factor)
        for low, high in pairwise(self.factor):
            if high > low:
                raise ValueError(f"factor must not rise with temperature, but {high:g} follows {low:g}")
        return self


class SpatialThermal(Section):
    """One-dimensional thermal model of one representative pack along the air path."""

    packs_per_string: Annotated[int, Field(ge=1)]
    length_m: Positive
    nodes: Annotated[int, Field(ge=2, le=10_000)]
    section_m2: Positive
    width_m: Positive
    density_kg_m3: Positive
    specific_heat_j_kgk: Positive
    conductivity_w_mk: NonNegative
    lateral_u_w_m2k: NonNegative
    end_u_w_m2k: NonNegative
    air_flow_kg_s: Positive
    air_cp_j_kgk: Positive


class LumpedThermal(Section):
    """Lumped thermal model of one string, as the controller sees it."""

    k1_k_per_j: Positive
    k2_per_s: NonNegative


class Thermal(Section):
    """Both thermal models of a string."""

    spatial: SpatialThermal
    lumped: LumpedThermal


class Site(Section):
    """Section ``[system]``: number of strings, ambient and initial state."""

    n_strings: Annotated[int, Field(ge=1, le=1000)]
    ambient_c: Temperature = 25.0
    initial_soc: Fraction = 0.5
    initial_temperature_c: Temperature = 25.0


class Control(Section):
    """Section ``[control]``: control step, horizon and plant step."""

    step_min: Positive = 15.0
    horizon_steps: Annotated[int, Field(ge=1, le=96)] = 8
    plant_step_s: Positive = 10.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        ratio = self.step_min * 60.0 / self.plant_step_s
        if abs(ratio - round(ratio)) > 1e-9 * ratio or ratio < 1.0 - 1e-9:
            raise ValueError(
                f"plant_step_s {self.plant_step_s:g} s does not divide the control step of {self.step_min:g} min"
            )
        return self
