"""Messages from clients, validated, and refused in one sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field

from bess.edge.plant_io.link import Measurements, StringReadings, measurements
from bess.edge.serve.string_monitor import MAX_READING_C, MIN_READING_C
from bess.errors import InputError
from bess.system import System
from bess.system.documents import describe
from bess.system.quantities import within

MAX_FORECAST: Final = 192
"""Values: two days of quarter hours."""
MAX_KW: Final = 1e6

Power = Annotated[float, within(-MAX_KW, MAX_KW, "kW")]
Limit = Annotated[float, within(0.0, MAX_KW, "kW")]
NowOrForecast = Annotated[
    Power | Annotated[list[Power], Field(min_length=1, max_length=MAX_FORECAST)],
    Field(
        description="Demand now [kW], positive = discharge; or a list: now, and the mean of each later step "
        "of the plan."
    ),
]


class Message(BaseModel):
    """Base: unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class StringMessage(Message):
    """Measurements of one string."""

    soc: Annotated[float, within(0.0, 1.0)] | None = Field(
        None, description="State of charge, 0 to 1; optional for a string that is not available."
    )
    temperature_c: Annotated[float, within(MIN_READING_C, MAX_READING_C, "degC")] | None = Field(
        None, description="Mean temperature [degC]; by default that of the surroundings."
    )
    limit_kw: Limit | None = Field(
        None, description="Present power limit of the inverter [kW]; by default its nominal power."
    )
    available: bool = Field(True, strict=True, description="Whether the string takes set-points.")
    power_kw: Power | None = Field(
        None,
        description="Measured power [kW], positive = discharge; shows whether the set-point is followed.",
    )

    def readings(self) -> StringReadings:
        """The measurements, without those that were not given."""
        limit_kw = math.inf if self.limit_kw is None else self.limit_kw
        given = self.model_dump(exclude={"limit_kw"}, exclude_none=True)
        return StringReadings(charge_limit_kw=limit_kw, discharge_limit_kw=limit_kw, **given)


class SplitMessage(Message):
    """A demand on the plant and measurements of its strings."""

    demand_kw: NowOrForecast
    plant_kw: Power | None = Field(
        None, description="Power of all strings at the plant's own meter [kW], positive = discharge."
    )
    strings: list[StringMessage] = Field(description="One entry for each string, in the order of the system.")


class DemandMessage(Message):
    """A demand on a plant that the service controls."""

    demand_kw: NowOrForecast
    valid_for_s: Annotated[float, within(1.0, 86_400.0, "s")] = Field(
        900.0, description="Validity [s]; afterwards all set-points of the plant are cleared."
    )


class CalibrationMessage(Message):
    """One string to be charged to full."""

    string: Annotated[int, Field(strict=True, ge=0)] = Field(description="Number of the string, from 0.")
    target_soc: Annotated[float, within(0.0, 1.0)] = Field(
        1.0, description="State of charge at which it ends."
    )


_BODIES: Final[Mapping[str, tuple[type[Message], str]]] = {
    "/v1/split": (
        SplitMessage,
        '{"demand_kw": 78.0, "strings": [{"soc": 0.5, "temperature_c": 25.0}, ...]}',
    ),
    "/v1/demand": (DemandMessage, '{"demand_kw": 78.0, "valid_for_s": 900}'),
    "/v1/calibration": (CalibrationMessage, '{"string": 0}'),
}
"""Message of each route, and an example."""


def sentence(problems: Sequence[Any], path: str) -> str:
    """The first problem of a body in one sentence: key, value, and allowed range.

    An unknown key precedes all others, as it may be the key that is missing, misspelt.
    """
    inside = [{**problem, "loc": problem["loc"][1:]} for problem in problems]  # the first part is "body"
    if not inside[0]["loc"]:
        return f"the body must be a JSON object, such as {_BODIES[path][1]}"
    if unknown := [problem for problem in inside if problem["type"] == "extra_forbidden"]:
        return describe(unknown[:1], _BODIES[path][0])
    return describe(inside, _BODIES[path][0]).split("; ")[0]


def measurements_of(message: SplitMessage, system: System) -> Measurements:
    """Return the measurements of a request."""
    strings = message.strings
    if len(strings) != system.n_strings:
        raise InputError(f"strings: {len(strings)} entries for a system of {system.n_strings} strings")
    for i, (string, nominal_kw) in enumerate(zip(strings, system.nominal_kw, strict=True)):
        if string.soc is None and string.available:
            raise InputError(
                f"strings[{i}].soc: missing; give a number in [0, 1], or available = false for a string "
                "out of service"
            )
        if string.limit_kw is not None and string.limit_kw > nominal_kw * (1.0 + 1e-9):
            raise InputError(
                f"strings[{i}].limit_kw = {string.limit_kw}: must be in [0, {nominal_kw:g}] kW, the power "
                "of its inverter"
            )
    plant_kw = math.nan if message.plant_kw is None else message.plant_kw
    return measurements([string.readings() for string in strings], plant_kw)
