"""Section ``[cooling]`` of a system file: coolant, thermostat and chiller."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from bess.system.quantities import Fraction, NonNegative, Positive, Ratio, Temperature, ascending
from bess.system.section import Section

Shares = Annotated[tuple[Fraction, ...], Field(min_length=1, max_length=20), AfterValidator(ascending)]


class CoolantLoop(Section):
    """Fully mixed coolant shared by all strings: the air of a container, or a circuit of pipes and a tank."""

    heat_capacity_kj_k: Positive
    wall_w_k: NonNegative = 0.0
    source_kw: Positive | None = None
    series: Annotated[bool, Field(strict=True)] = False


class _Cooling(Section):
    """Common parameters; a kind is a class of defaults here and a file in the plant's ``cooling/kinds``."""

    flow_kg_s: Positive | None = None
    cp_j_kgk: Positive | None = None
    u_w_m2k: NonNegative | None = None
    density_kg_m3: Positive
    pressure_pa: NonNegative
    mover_efficiency: Annotated[Fraction, Field(gt=0.0)]
    start_c: Temperature | None = None
    dead_band_k: NonNegative = 5.0
    flow_steps: Shares = (1.0,)
    step_k: NonNegative = 5.0
    variable_flow: Annotated[bool, Field(strict=True)] = False
    supply_c: Temperature | None = None
    approach_k: NonNegative = 5.0
    carnot_share: Annotated[Fraction, Field(gt=0.0)] = 0.4
    cop_max: Ratio = 6.0
    free_cooling_w_per_w: NonNegative = 0.03
    loop: CoolantLoop | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.flow_steps[0] <= 0.0:
            raise ValueError("flow_steps: a stage of flow is above 0; below start_c nothing flows")
        if self.variable_flow and self.start_c is None:
            raise ValueError("variable_flow needs start_c, the temperature at which the flow begins")
        return self


class AirCooling(_Cooling):
    """Forced ambient air, or air from a room held at ``supply_c``; ``[thermal]`` gives the flow."""

    kind: Literal["air"]
    density_kg_m3: Positive = 1.2
    pressure_pa: NonNegative = 250.0
    mover_efficiency: Annotated[Fraction, Field(gt=0.0)] = 0.4

    @model_validator(mode="after")
    def _check_sink(self) -> Self:
        if self.loop is not None and self.supply_c is None and self.loop.wall_w_k == 0.0:
            raise ValueError("the air of loop has no heat sink; set supply_c, or loop.wall_w_k above 0 W/K")
        return self


class LiquidCooling(_Cooling):
    """Cold plates with 40 % water glycol, from a chiller or, at low ambient temperature, a dry cooler."""

    kind: Literal["liquid"]
    flow_kg_s: Positive = 0.05
    cp_j_kgk: Positive = 3330.0
    u_w_m2k: NonNegative = 300.0
    density_kg_m3: Positive = 1069.5
    pressure_pa: NonNegative = 50e3
    mover_efficiency: Annotated[Fraction, Field(gt=0.0)] = 0.5
    start_c: Temperature = 30.0
    supply_c: Temperature = 20.0


class HybridCooling(LiquidCooling):
    """Cold plates behind a dry cooler, and behind a chiller while the warmest string is above ``chill_c``."""

    kind: Literal["hybrid"]  # type: ignore[assignment]
    chill_c: Temperature = 35.0


Cooling = Annotated[AirCooling | LiquidCooling | HybridCooling, Field(discriminator="kind")]
