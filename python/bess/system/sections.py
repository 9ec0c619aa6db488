"""Sections of a system file other than the battery, one class each, as in ``data/systems/reference.toml``."""

from itertools import pairwise
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, Field, model_validator

from bess.system.components.loss_table import check_losses
from bess.system.quantities import (
    AgeingModel,
    AtEndOfLife,
    Count,
    EndOfLife,
    Fraction,
    Loss,
    NonNegative,
    Positive,
    Power,
    SohCapacity,
    SohResistance,
    Temperature,
    TemperatureAxis,
    ascending,
    within,
)
from bess.system.section import Section, Table
from bess.units import SECONDS_PER_HOUR, SECONDS_PER_MINUTE

SMALL_SHARE = 0.01
"""Upper limit of the minimum power of an inverter, as a share of its nominal power."""

PRICES_ONLY = ("none", "throughput")
"""Wear models that do not change capacity and resistance."""


class About(Section):
    """Section ``[about]``: description, sources and licence of a file.

    ``cell`` and ``inverter`` describe components of the system that are also bundled separately.
    """

    description: str
    source: str
    licence: str
    cell: str = ""
    inverter: str = ""


class Inverter(Table):
    """Inverter of one string: losses over delivered AC power, both as fractions of nominal AC power.

    ``load`` starts at 0 (the no-load loss of an inverter that is on) and ends at 1. Below ``min_power_kw`` an
    inverter is off; set-points are 0 or at least ``min_power_kw``.
    """

    axes: ClassVar = {"loss_charge": ("load",), "loss_discharge": ("load",)}

    nominal_kw: Power
    load: Annotated[tuple[Fraction, ...], Field(min_length=2), AfterValidator(ascending)]
    loss_charge: tuple[Loss, ...]
    loss_discharge: tuple[Loss, ...]
    off_loss: Annotated[float, within(0.0, 0.1, "of nominal power", below=True)] = 0.0
    min_power_kw: Annotated[float, within(0.0, 1.0, "kW", above=True)] = 1e-3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.load[0] != 0.0 or self.load[-1] != 1.0:
            raise ValueError(f"load must run from 0 to 1, not from {self.load[0]:g} to {self.load[-1]:g}")
        check_losses(self.load, self.loss_charge, "charge")
        check_losses(self.load, self.loss_discharge, "discharge")
        if self.min_power_kw > SMALL_SHARE * self.nominal_kw:
            raise ValueError(
                f"min_power_kw = {self.min_power_kw:g} kW must be at most {SMALL_SHARE:.0%} of nominal_kw = "
                f"{self.nominal_kw:g} kW: below it an inverter is off"
            )
        return self


class Derating(Table):
    """Temperature derating: the factor table and the gains of the PI law."""

    axes: ClassVar = {"factor": ("temperature_c",)}

    start_c: Temperature
    stop_c: Temperature
    kp_per_k: NonNegative
    ki_per_k_step: NonNegative
    temperature_c: TemperatureAxis
    factor: tuple[Fraction, ...]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.start_c >= self.stop_c:
            raise ValueError(f"start_c {self.start_c:g} degC must be below stop_c {self.stop_c:g} degC")
        for low, high in pairwise(self.factor):
            if high > low:
                raise ValueError(f"factor must not rise with temperature, but {high:g} follows {low:g}")
        return self


class SpatialThermal(Section):
    """One-dimensional thermal model of one representative pack along the air path."""

    packs_per_string: Count
    length_m: Positive
    nodes: Annotated[int, within(2, 10_000)]
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
    """Lumped thermal model of one string, used by the controller."""

    k1_k_per_j: Positive
    k2_per_s: NonNegative


class Thermal(Section):
    """Both thermal models of a string."""

    spatial: SpatialThermal
    lumped: LumpedThermal


class Wear(Section):
    """Section ``[wear]``: ageing of a string and its cost.

    ``model`` is a cell model (``bess list``), ``"throughput"`` (a price per MWh discharged and no physics) or
    ``"none"``. A cell model's loss of capacity costs ``loss / (1 - end_of_life) * replacement_eur_kwh`` per
    kWh of nominal energy. ``calendar_share`` is the share of calendar ageing in the initial loss. A
    string that reaches ``end_of_life`` continues, is retired, or gets a new battery (``at_end_of_life``).
    """

    model: AgeingModel = "none"
    replacement_eur_kwh: NonNegative = 200.0
    end_of_life: EndOfLife = 0.8
    eur_per_mwh: NonNegative | None = None
    calendar_share: Fraction = 0.5
    at_end_of_life: AtEndOfLife = "continue"

    @property
    def cell_model(self) -> str | None:
        """Name of the cell ageing model; None if capacity and resistance are constant."""
        return None if self.model in PRICES_ONLY else self.model

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.model == "throughput" and self.eur_per_mwh is None:
            raise ValueError('model = "throughput" needs eur_per_mwh, the price of a MWh discharged (AC)')
        return self


class SystemDefaults(Section):
    """Section ``[system]``: number of strings, ambient and initial state."""

    n_strings: Annotated[int, within(1, 1000)]
    ambient_c: Temperature = 25.0
    initial_soc: Fraction = 0.5
    initial_temperature_c: Temperature = 25.0
    initial_soh_capacity: SohCapacity = 1.0
    initial_soh_resistance: SohResistance = 1.0


class Control(Section):
    """Section ``[control]``: control step, horizon and plant step."""

    step_min: Annotated[float, within(0.0, 1440.0, "min", above=True)] = 15.0
    horizon_steps: Annotated[int, within(1, 96)] = 8
    plant_step_s: Annotated[float, within(1e-3, 86_400.0, "s")] = 10.0

    @property
    def step_s(self) -> float:
        """Control step [s]."""
        return SECONDS_PER_MINUTE * self.step_min

    @property
    def dt_h(self) -> float:
        """Control step [h]."""
        return self.step_s / SECONDS_PER_HOUR

    @model_validator(mode="after")
    def _check(self) -> Self:
        ratio = self.step_s / self.plant_step_s
        if abs(ratio - round(ratio)) > 1e-9 * ratio or ratio < 1.0 - 1e-9:
            raise ValueError(
                f"plant_step_s {self.plant_step_s:g} s does not divide the control step of "
                f"{self.step_min:g} min"
            )
        return self
