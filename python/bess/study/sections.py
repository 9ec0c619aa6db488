"""Sections of a study file except ``[demand]``; validated on load."""

import math
import re
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from bess.files import Fill
from bess.study.keys import dotted
from bess.system.quantities import (
    AgeingModel,
    AtEndOfLife,
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
from bess.system.section import Section


def _not_a_number(value: Any) -> Any:
    # pydantic takes a number, such as a year, for seconds since 1970.
    if isinstance(value, int | float) or re.fullmatch(r"\s*[+-]?[\d.]+\s*", str(value)):
        raise ValueError("is no time; write for example 2024-01-01T00:00:00Z")
    return value


def _aware(value: datetime) -> datetime:
    if value.tzinfo is None:
        raise ValueError("has no time zone; write for example 2024-01-01T00:00:00Z")
    return value.astimezone(UTC)


_MAX_NAME_LENGTH = 200
"""Characters; file systems allow 255 bytes."""


def _folder_name(value: str) -> str:
    if len(value) > _MAX_NAME_LENGTH:
        raise ValueError(f"has {len(value)} characters, at most {_MAX_NAME_LENGTH} are allowed")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._=+-]*", value):
        raise ValueError(
            "names a folder, so it must begin with a letter or a digit and hold only these and . _ = + -"
        )
    return value


RunName = Annotated[str, AfterValidator(_folder_name)]
"""Name of a run and of its folder."""


def _time_zone(value: str) -> str:
    try:
        return value if _FIXED_OFFSET.fullmatch(value) else ZoneInfo(value).key
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ValueError("is no time zone; write a name such as Europe/Berlin, or UTC+01:00") from None


_FIXED_OFFSET = re.compile(r"UTC[+-](0\d|1[0-4]):[0-5]\d")
TimeZone = Annotated[str, AfterValidator(_time_zone)]
"""Name of a time zone (IANA), or a fixed offset."""

Instant = Annotated[datetime, BeforeValidator(_not_a_number), AfterValidator(_aware)]


DottedKey = Annotated[str, AfterValidator(dotted)]


class SystemSection(Section):
    """Section ``[system]``: plant and its overrides.

    ``file`` is a bundled system (``bess list``) or a system file. ``parameters`` contains sections of a
    system file that override it, such as ``parameters.battery.r_scale = 1.2``. Initial values are one number
    for all strings or one per string.
    """

    file: str = "reference"
    n_strings: Annotated[int, within(1, 1000)] | None = None
    ambient_c: Temperature | None = None
    initial_soc: Fraction | tuple[Fraction, ...] | None = None
    initial_temperature_c: Temperature | tuple[Temperature, ...] | None = None
    initial_soh_capacity: SohCapacity | tuple[SohCapacity, ...] | None = None
    initial_soh_resistance: SohResistance | tuple[SohResistance, ...] | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)


class WeatherSection(Section):
    """Section ``[weather]``: ambient temperature from a file; by default that of the system.

    The file is read with :func:`bess.market.read_weather`. ``offset_k`` is added, for example for a warm
    container. ``repeat`` repeats the last year, as for prices; a typical year always repeats.
    """

    file: str | None = None
    column: str | None = None
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    offset_k: Annotated[float, within(-50.0, 50.0, "K")] = 0.0


class RunSection(Section):
    """Section ``[run]``: period and plant simulation; the default period is that of the demand."""

    start: Instant | None = None
    days: Annotated[float, within(0.0, 36_525.0, "days", above=True)] | None = None
    plant_step_s: Positive | None = None
    derating_law: Literal["table", "pi"] = "table"


class WearSection(Section):
    """Section ``[wear]``: cost of battery ageing.

    The keys override the section ``[wear]`` of the system file; its ``[[string]]`` tables still have
    precedence. ``throughput`` is a price ``eur_per_mwh`` per MWh discharged (AC). With a cell model the
    strings age and the capacity loss has a price; ``eur_per_mwh`` then replaces the rates of the model in the
    dispatch.
    """

    model: AgeingModel | None = None
    replacement_eur_kwh: NonNegative | None = None
    end_of_life: EndOfLife | None = None
    eur_per_mwh: NonNegative | None = None
    calendar_share: Fraction | None = None
    at_end_of_life: AtEndOfLife | None = None


class BudgetSection(Section):
    """Section ``[budget]``: maximum cycles or throughput of trading per year, for example of a warranty.

    ``cycles_per_year`` counts the larger of charged and discharged energy relative to the nominal energy, and
    ``throughput_mwh_per_year`` limits discharged energy (AC). Years begin at the start of the run, and a part
    of a year has the same part of the budget. The dispatch uses a shadow price
    (:class:`bess.dispatch.CycleBudget`) and never exceeds a budget.
    """

    cycles_per_year: Positive | None = None
    throughput_mwh_per_year: Positive | None = None

    @property
    def is_set(self) -> bool:
        """Whether there is a budget."""
        return self.cycles_per_year is not None or self.throughput_mwh_per_year is not None


class ContractSection(Section):
    """Section ``[contract]``: guaranteed figures, which the KPIs compare with the run.

    ``availability_pct`` is the share of the demanded energy that is delivered, outages included;
    ``throughput_mwh`` the energy that may be discharged (AC) over the contract, the run included.
    """

    round_trip_efficiency_pct: Annotated[float, within(0.0, 100.0, "%", above=True)] | None = None
    availability_pct: Annotated[float, within(0.0, 100.0, "%", above=True)] | None = None
    throughput_mwh: Positive | None = None


class OutputSection(Section):
    """Section ``[output]``: optional variables of the record."""

    node_temperatures: bool = False


class ServiceSection(Section):
    """Section ``[service]``: live controller of ``bess serve``.

    Values per string are one number for all strings or a list. Times are in seconds. ``start_kwh`` is the
    energy equivalent of an inverter start: an inverter is switched after this saving has accumulated.
    ``bess run`` ignores this section: its plant follows the set-points of the policy in every control step,
    within the SOC limits of the system (``soc_min``, ``soc_max``).
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
    calibration_days: Annotated[float, within(1.0, 3_650.0, "days")] | None = None
    watchdog_s: Annotated[float, within(1.0, 86_400.0, "s")] = 65.0
    late_after_s: Annotated[float, within(1.0, 3_600.0, "s")] = 60.0
    frozen_readings: Count = 10
    retry_after_s: Annotated[float, within(1.0, 86_400.0, "s")] = 300.0
    follow_profile: bool = False
    requests_per_s: Annotated[float, within(0.1, 1e5)] = 1000.0
    journal_mb: Annotated[float, within(1.0, 1e6, "MB")] = 2000.0


class Event(Section):
    """Table ``[[event]]``: temporary power limit ``limit_kw`` of the inverter of ``string`` (from 0).

    ``limit_kw = 0`` takes the string out of service. With ``announced = true``, such as maintenance, policies
    that plan ahead know its start and end. Otherwise, as for a failure, they have no information about it
    before it begins, and expect it to last.
    """

    string: Annotated[int, Field(strict=True, ge=0)]
    start: Instant
    end: Instant
    limit_kw: NonNegative = 0.0
    announced: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.end <= self.start:
            raise ValueError(f"end {self.end:%Y-%m-%d %H:%M} is not after start {self.start:%Y-%m-%d %H:%M}")
        return self


class Replacement(Section):
    """Table ``[[replacement]]``: a new battery of ``string`` (from 0) at ``date``.

    The battery costs ``eur_kwh`` per kWh of nominal energy, by default ``wear.replacement_eur_kwh``.
    """

    string: Annotated[int, Field(strict=True, ge=0)]
    date: Instant
    eur_kwh: NonNegative | None = None


class Augmentation(Replacement):
    """Table ``[[augmentation]]``: ``string`` (from 0) is added at ``date``, at the cost of its battery.

    Until then it is not there: it has no power, no wear cost and no end of life.
    """


class Scenario(Section):
    """Table ``[[scenario]]``: name and dotted keys to set (as with ``--set``)."""

    name: RunName
    set: dict[DottedKey, Any]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if own := sorted({"name", "scenario", "sweep"} & {key.partition(".")[0] for key in self.set}):
            raise ValueError(f"set.{own[0]}: a scenario is one run, with the name that its table gives")
        return self


class Axis(Section):
    """Table ``[[sweep]]``: one axis of a sweep; all axes are combined.

    Either ``key`` with ``values`` or with a range (``start``, ``stop``, ``count`` points), or ``simplex``:
    keys that share a total of 1, in every combination of multiples of ``1 / divisions``. A study with one
    axis of numbers may search it: ``maximise`` names a KPI, and ``refine`` times two runs are added, half-way
    between the best value so far and its neighbours.
    """

    key: DottedKey | None = None
    values: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None
    start: float | None = None
    stop: float | None = None
    count: Annotated[int, Field(strict=True, ge=2)] | None = None
    simplex: Annotated[tuple[DottedKey, ...], Field(min_length=2)] | None = None
    divisions: Count | None = None
    maximise: str | None = None
    refine: Count | None = None

    @property
    def size(self) -> int:
        """Number of points."""
        if self.simplex is not None and self.divisions is not None:
            return math.comb(self.divisions + len(self.simplex) - 1, self.divisions)
        return self.count if self.values is None and self.count is not None else len(self.values or ())

    @model_validator(mode="after")
    def _check(self) -> Self:
        search = {"maximise", "refine"}
        given = {name for name in type(self).model_fields if getattr(self, name) is not None}
        if given & search and (not search <= given or "simplex" in given):
            raise ValueError("a search is maximise + refine, of one key")
        given -= search
        allowed = ({"key", "values"}, {"key", "start", "stop", "count"}, {"simplex", "divisions"})
        if given not in allowed:
            raise ValueError(
                "an axis is key + values, key + start + stop + count, or simplex + divisions, not "
                + (" + ".join(sorted(given)) or "empty")
            )
        return self


class ReactiveSection(Section):
    """Section ``[reactive]``: reactive power demand in addition to active power.

    Either ``kvar`` (constant), ``power_factor`` (in proportion to active power) or ``file``, read with
    :func:`bess.dispatch.read_profile`. Positive = supplied to the grid (over-excited).
    """

    kvar: Annotated[float, within(-1e6, 1e6, "kvar")] | None = None
    power_factor: Annotated[float, within(0.0, 1.0, above=True)] | None = None
    file: str | None = None
    column: str | None = None
    unit: Literal["kvar", "var", "Mvar"] = "kvar"
    scale: Positive = 1.0
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    forecast: Literal["perfect", "persistence"] = "perfect"

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = [name for name in ("kvar", "power_factor", "file") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of kvar, power_factor and file, not {' and '.join(given) or 'none'}")
        return self
