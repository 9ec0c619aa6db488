"""Physical quantities of a system file with their units and valid ranges.

The ranges include every realistic plant, and no product of two values overflows. Strings, booleans,
NaN and infinity are not accepted.
"""

from dataclasses import KW_ONLY, dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from bess._core import ageing_models
from bess.system.state import SOH_CAPACITY_RANGE, SOH_RESISTANCE_RANGE


@dataclass(frozen=True)
class InRange:
    """Validator of the range ``[low, high]``; ``above`` and ``below`` exclude the end of the range."""

    low: float
    high: float
    unit: str = ""
    _: KW_ONLY
    above: bool = False
    below: bool = False

    def __call__(self, value: float) -> float:
        """Return the value if it is in the range.

        Raises
        ------
        ValueError
            The value is outside its range; the message gives the range.
        """
        inside = self.low < value < self.high
        if inside or (value == self.low and not self.above) or (value == self.high and not self.below):
            return value
        left, right = "(" if self.above else "[", ")" if self.below else "]"
        unit = f" {self.unit}" if self.unit else ""
        raise ValueError(f"must be in {left}{self.low:g}, {self.high:g}{right}{unit}")

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return a schema that checks the type of the field, without conversion, and its range."""
        return core_schema.no_info_after_validator_function(self, {**handler(source), "strict": True})

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the range as JSON schema."""
        low, high = (
            "exclusiveMinimum" if self.above else "minimum",
            "exclusiveMaximum" if self.below else "maximum",
        )
        return {**handler(core), low: self.low, high: self.high}


within = InRange

Count = Annotated[int, within(1, 10_000)]
Fraction = Annotated[float, within(0.0, 1.0)]
Loss = Annotated[float, within(0.0, 1.0, "of nominal power", below=True)]
Ratio = Annotated[float, within(0.0, 100.0, above=True)]
Temperature = Annotated[float, within(-60.0, 150.0, "degC")]
CellVoltage = Annotated[float, within(0.0, 10.0, "V", above=True)]
CellResistance = Annotated[float, within(0.0, 1e6, "mOhm", above=True)]
CellCapacity = Annotated[float, within(0.0, 1e5, "Ah", above=True)]
CellMass = Annotated[float, within(0.0, 1e4, "kg", above=True)]
EntropyCoefficient = Annotated[float, within(-5.0, 5.0, "mV/K")]
Power = Annotated[float, within(0.0, 1e6, "kW", above=True)]
Positive = Annotated[float, within(0.0, 1e6, above=True)]
NonNegative = Annotated[float, within(0.0, 1e6)]
Price = Annotated[float, within(-1e6, 1e6, "EUR/MWh")]

EndOfLife = Annotated[float, within(0.0, 1.0, below=True)]
SohCapacity = Annotated[float, within(*SOH_CAPACITY_RANGE)]
SohResistance = Annotated[float, within(*SOH_RESISTANCE_RANGE)]


def ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return ``values`` if they increase strictly.

    Raises
    ------
    ValueError
        The first pair that does not increase.
    """
    for first, second in pairwise(values):
        if second <= first:
            raise ValueError(f"knots must ascend, but {second:g} follows {first:g}")
    return values


SocAxis = Annotated[tuple[Fraction, ...], Field(min_length=2), AfterValidator(ascending)]
TemperatureAxis = Annotated[tuple[Temperature, ...], Field(min_length=1), AfterValidator(ascending)]
RateAxis = Annotated[tuple[Ratio, ...], Field(min_length=1), AfterValidator(ascending)]


def _is_ageing_model(name: str) -> str:
    known = ["none", "throughput", *(model for model, _ in ageing_models())]
    if name not in known:
        raise ValueError(f"is no model of ageing; allowed: {', '.join(known)}")
    return name


AgeingModel = Annotated[str, AfterValidator(_is_ageing_model)]
AtEndOfLife = Literal["continue", "retire", "replace"]
