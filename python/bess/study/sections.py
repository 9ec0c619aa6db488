"""Sections of a study file but those of demand, reactive power and policy, checked once at load."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from bess.files import Fill
from bess.parameters.quantities import (
    AgeingModel,
    Count,
    EndOfLife,
    Fraction,
    NonNegative,
    Positive,
    SohCapacity,
    SohResistance,
    Temperature,
    within,
)
from bess.parameters.section import Section
from bess.parameters.terms import Terms


def _aware(value: datetime) -> datetime:
    if value.tzinfo is None:
        raise ValueError("has no time zone; write for example 2024-01-01T00:00:00Z")
    return value.astimezone(UTC)


_LONGEST_NAME = 200
"""Characters; file systems allow 255 bytes."""


def _folder_name(value: str) -> str:
    if len(value) > _LONGEST_NAME:
        raise ValueError(f"has {len(value)} characters, at most {_LONGEST_NAME} are allowed")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._=+-]*", value):
        raise ValueError(
            "names a folder, so it must begin with a letter or a digit and hold only these and . _ = + -"
        )
    return value


RunName = Annotated[str, AfterValidator(_folder_name)]
"""Name of a run, which is that of its folder as well."""

Instant = Annotated[datetime, AfterValidator(_aware)]


class SystemChoice(Section):
    """Section ``[system]``: which plant, and what is changed in it.

    ``file`` is a bundled system (``bess list``) or a system file. ``parameters`` holds sections of a system
    file that are put over it, such as ``parameters.battery.r_scale = 1.2``. Initial values are one number for
    all strings or one for each.
    """

    file: str = "reference"
    n_strings: Annotated[int, Field(ge=1, le=1000)] | None = None
    ambient_c: Temperature | None = None
    initial_soc: Fraction | tuple[Fraction, ...] | None = None
    initial_temperature_c: Temperature | tuple[Temperature, ...] | None = None
    initial_soh_capacity: SohCapacity | tuple[SohCapacity, ...] | None = None
    initial_soh_resistance: SohResistance | tuple[SohResistance, ...] | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)


class WeatherChoice(Section):
    """Section ``[weather]``: ambient temperature from a file; without it, it is that of the system.

    The file is read as :func:`bess.market.read_weather` says. ``offset_k`` is added, such as for a warm
    container. ``repeat`` is that of prices; a typical year repeats without it.
    """

    file: str | None = None
    column: str | None = None
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    offset_k: Annotated[float, within(-50.0, 50.0, "K")] = 0.0


class RunChoice(Section):
    """Section ``[run]``: period and plant. ``start`` and ``days`` default to what the demand covers."""

    start: Instant | None = None
    days: Annotated[float, within(0.0, 36_525.0, "days", above=True)] | None = None
    plant_step_s: Positive | None = None
    derating_law: Literal["table", "pi"] = "table"


class SettlementChoice(Section):
    """Section ``[settlement]``: what is agreed on beside the price of energy, for studies with prices.

    Energy asked for and not delivered costs the magnitude of its price and ``shortfall_eur_mwh``. Fees are on
    each MWh charged or discharged (AC), ``start_eur`` is for each start of an inverter. Reserve that was sold
    and not there costs its price times ``capacity_penalty``. ``discount_rate`` is that of the net present
    value of runs over years.
    """

    shortfall_eur_mwh: NonNegative = Terms.shortfall_eur_mwh
    charge_fee_eur_mwh: NonNegative = Terms.charge_fee_eur_mwh
    discharge_fee_eur_mwh: NonNegative = Terms.discharge_fee_eur_mwh
    start_eur: NonNegative = Terms.start_eur
    discount_rate: Annotated[float, within(0.0, 1.0, "per year")] = Terms.discount_rate
    capacity_penalty: NonNegative = Terms.capacity_penalty

    @property
    def terms(self) -> Terms:
        """The section as what dispatch and settlement work with."""
        return Terms(**self.model_dump())


class WearChoice(Section):
    """Section ``[wear]``: what using the batteries costs.

    The keys of the section ``[wear]`` of a system file, put over it; ``[[string]]`` tables there still
    override them for one string. ``throughput`` is a price ``eur_per_mwh`` for each MWh discharged (AC). A
    cell model lets the strings age and prices the capacity lost; ``eur_per_mwh`` is then what a dispatch
    plans with instead of the model's own rates.
    """

    model: AgeingModel | None = None
    replacement_eur_kwh: NonNegative | None = None
    end_of_life: EndOfLife | None = None
    eur_per_mwh: NonNegative | None = None
    calendar_share: Fraction | None = None


class OutputChoice(Section):
    """Section ``[output]``: what is recorded beside the table of ``ARCHITECTURE.md``."""

    node_temperatures: bool = False


class ServiceChoice(Section):
    """Section ``[service]``: how the live controller of ``bess serve`` acts between two plans.

    What stands for each string is one number for all of them or a list. Times in seconds; ``start_kwh`` is
    what a start of an inverter is worth: it is switched when that much energy would have been saved.
    ``bess run`` uses none of these keys: its plant takes the policy's set-points at every control step, and
    its windows of SOC are those of the system (``soc_min``, ``soc_max``).
    """

    control_step_s: Annotated[float, within(1.0, 900.0, "s")] | None = None
    answer_within_s: Annotated[float, within(0.01, 10.0, "s")] = 0.5
    minimum_power_kw: NonNegative | tuple[NonNegative, ...] = 0.0
    minimum_on_s: Annotated[float, within(0.0, 86_400.0, "s")] = 0.0
    minimum_off_s: Annotated[float, within(0.0, 86_400.0, "s")] = 0.0
    start_kwh: NonNegative = 0.1
    ramp_kw_per_s: Positive | None = None
    soc_floor: Fraction | tuple[Fraction, ...] = 0.0
    soc_ceiling: Fraction | tuple[Fraction, ...] = 1.0
    calibration_kw: Positive | None = None
    late_after_s: Annotated[float, within(1.0, 3_600.0, "s")] = 60.0
    frozen_readings: Count = 10
    retry_after_s: Annotated[float, within(1.0, 86_400.0, "s")] = 300.0
    follow_profile: bool = False
    requests_per_s: Annotated[float, within(0.1, 1e5)] = 1000.0
    journal_mb: Annotated[float, within(1.0, 1e6, "MB")] = 2000.0


class Event(Section):
    """Table ``[[event]]``: the inverter of ``string`` (from 0) gives no more than ``limit_kw`` for a while.

    ``limit_kw = 0`` takes the string out of service. The policy learns of an event when it begins.
    """

    string: Annotated[int, Field(ge=0)]
    start: Instant
    end: Instant
    limit_kw: NonNegative = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.end <= self.start:
            raise ValueError(f"end {self.end:%Y-%m-%d %H:%M} is not after start {self.start:%Y-%m-%d %H:%M}")
        return self


class Scenario(Section):
    """Table ``[[scenario]]``: a name, and the keys it sets (dotted, as with ``--set``)."""

    name: RunName
    set: dict[str, Any]


class Axis(Section):
    """Table ``[[sweep]]``: one axis of a sweep; several axes are combined with each other.

    Either ``key`` with ``values`` or with a range (``start``, ``stop``, ``count`` points), or ``simplex``:
    keys whose values are all shares ``i / divisions`` that sum to 1.
    """

    key: str | None = None
    values: tuple[Any, ...] | None = None
    start: float | None = None
    stop: float | None = None
    count: Annotated[int, Field(ge=2)] | None = None
    simplex: Annotated[tuple[str, ...], Field(min_length=2)] | None = None
    divisions: Count | None = None

    @property
    def size(self) -> int:
        """Number of points, without making them."""
        if self.simplex is not None and self.divisions is not None:
            return math.comb(self.divisions + len(self.simplex) - 1, self.divisions)
        return self.count if self.values is None and self.count is not None else len(self.values or ())

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = {name for name in type(self).model_fields if getattr(self, name) is not None}
        allowed = ({"key", "values"}, {"key", "start", "stop", "count"}, {"simplex", "divisions"})
        if given not in allowed:
            raise ValueError(
                "an axis is key + values, key + start + stop + count, or simplex + divisions, not "
                + (" + ".join(sorted(given)) or "empty")
            )
        return self
