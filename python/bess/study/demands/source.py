"""Common parts of the kinds of demand: the setting of a run, and the source of the demand of each step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final

import numpy as np

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.dispatch import CycleBudget, Forecast, PerfectForecast, PersistenceForecast, read_profile
from bess.dispatch.forecast import steps_in
from bess.study.grid import SampledSeries, TimeGrid, seconds_of
from bess.study.keys import check_bundled
from bess.study.sections import BudgetSection, RunSection
from bess.system import State, System
from bess.system.quantities import within
from bess.system.section import Section
from bess.system.terms import SettlementTerms
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import pandas as pd

DEFAULT_START: Final = datetime(2024, 1, 1, tzinfo=UTC)
"""Start of a run whose demand has no time stamps."""
Efficiency = Annotated[float, within(0.0, 1.0, above=True)]

SYNTHETIC: Final = "synthetic"
"""Name of the bundled weeks of grid frequency and of prices."""


class DemandSection(Section):
    """Section ``[demand]`` of one kind: its keys, and :meth:`build`, which reads its files."""

    files: ClassVar[tuple[str, ...]]
    """Keys that name a file; ``*`` stands for the entries of a list."""
    trades: ClassVar[bool] = False
    """Whether it trades at variable prices."""

    @abstractmethod
    def build(self, setting: Setting) -> RunDemand:
        """Read the files of the section and resample them to the control steps of the run."""


def prices_of(file: str, zone: str, product: str | None = None, **reading: Any) -> pd.Series[float]:
    """Return the prices in a file; scenarios that share it read it once."""
    version: tuple[int, ...] = ()
    with suppress(OSError, ValueError):  # the reader says what is wrong
        found = Path(file).stat()
        version = (found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size)
    return _prices(version, file, zone, product, **reading)


@lru_cache(maxsize=8)
def _prices(
    _: tuple[int, ...], file: str, zone: str, product: str | None, **reading: Any
) -> pd.Series[float]:
    from bess.market import read_prices

    return read_prices(file, zone, product, **reading)


@dataclass(frozen=True)
class RunDemand:
    """Demand of a run."""

    grid: TimeGrid
    """Control steps of the run."""
    demand: DemandSource
    """Source of the demand, called once for each step."""
    price_eur_mwh: Array | None = None
    """``(n_steps,)``: price of energy, if the study has one."""
    series: Mapping[str, Array] = field(default_factory=dict)
    """``(n_steps,)``: other recorded series, by variable name."""
    price_ahead: Callable[[int, int], Array] | None = None
    """Price of a step and of the next ones, up to a horizon, as forecast at its start; None if known."""


@dataclass(frozen=True)
class Setting:
    """The run that a demand is built for, and the files read for it."""

    name: str
    run: RunSection
    """Start and length of the run, as far as the study sets them."""
    budget: BudgetSection
    terms: SettlementTerms
    system: System
    files: list[Path] = field(default_factory=list)
    """Files read so far."""
    notes: list[str] = field(default_factory=list)
    """Notes on these files, for display."""

    @property
    def start(self) -> datetime:
        """Start of a series without time stamps."""
        return self.run.start or DEFAULT_START

    def grid_of(self, series: SampledSeries) -> TimeGrid:
        """Return the control steps of the run; by default it covers the series."""
        start, step_s = self.run.start or series.grid.start, self.system.control.step_s
        return TimeGrid.of(start, step_s, self.run.days or series.days_from(start, step_s))

    def series_of(
        self, read: pd.Series[float], file: str, key: str, repeat_key: str | None = None
    ) -> SampledSeries:
        """Return what a reader returned for ``file``, and list the file."""
        if Path(file) not in self.files:
            self.files.append(Path(file))
        return SampledSeries.from_pandas(read, file, key, repeat_key)

    def power_of(
        self,
        name: str,
        key: str,
        bundled: Mapping[str, Callable[..., Array]],
        *,
        scale: float,
        **reading: Any,
    ) -> SampledSeries:
        """Return a profile, bundled or from a file.

        ``reading`` are further arguments of :func:`bess.dispatch.read_profile`.
        """
        check_bundled(key, name, bundled)
        control, repeat_key = self.system.control, f"{key.rpartition('.')[0]}.repeat"
        if name in bundled:
            values, start_s = bundled[name](dt_h=control.dt_h) * scale, seconds_of(self.start)
            return SampledSeries(values, start_s, round(control.step_s), f"profile {name}", key, repeat_key)
        read = read_profile(name, scale=scale, dt_h=control.dt_h, **reading)
        return self.series_of(read, name, key, repeat_key)

    def note(self, text: str, series: SampledSeries | None = None) -> None:
        """Add a note, followed by the repairs of a series."""
        self.notes.extend([text, *(series.repairs if series is not None else ())])

    def budget_of(
        self,
        grid: TimeGrid,
        prices: Forecast,
        size: Callable[[State, Array], tuple[float, float]],
        efficiency: float,
        look_ahead_h: float,
        cycles_per_day: float | None,
        wear_eur_mwh: Callable[[State, Array], float] | None = None,
    ) -> CycleBudget | None:
        """Return the yearly budget, if any.

        ``size`` returns power [kW] and energy [kWh] available for trading, ``cycles_per_day`` is the daily
        limit of plans, and ``wear_eur_mwh`` the wear cost in them; see :class:`bess.dispatch.CycleBudget`.
        """
        limits = self.budget
        if not limits.is_set:
            return None
        power_kw, energy_kwh = size(self.system.initial_state(), self.system.nominal_kw)
        return CycleBudget(
            prices,
            grid.years,
            grid.n_steps,
            cycles=limits.cycles_per_year or np.inf,
            throughput_kwh=KWH_PER_MWH * (limits.throughput_mwh_per_year or np.inf),
            nominal_kwh=self.system.nominal_energy_kwh,
            usable_kwh=energy_kwh,
            power_kw=power_kw,
            efficiency=efficiency,
            look_ahead_steps=steps_in(look_ahead_h, grid.dt_h, "demand.look_ahead_h"),
            dt_h=grid.dt_h,
            daily_kwh=(cycles_per_day or np.inf) * energy_kwh,
            fees_eur_mwh=self.terms.fees_eur_mwh,
            wear_eur_mwh=wear_eur_mwh,
            size=size,
        )


def forecast_of(kind: str, values: Array, dt_h: float) -> Forecast:
    """Return the ``"perfect"`` or ``"persistence"`` forecast of a series."""
    return PerfectForecast(values) if kind == "perfect" else PersistenceForecast(values, dt_h)


@dataclass(frozen=True)
class StepInputs:
    """Measurements and forecasts at the start of a step."""

    state: State
    """Measured state of every string."""
    limit_kw: Array
    """``(n_strings,)``: power of each inverter in service."""
    ambient_c: Array
    """``(n_steps_left,)``: ambient temperature of this step and the remaining steps, as in a weather
    forecast."""
    delivered_kw: float = 0.0
    """Mean power of the plant in the previous step, positive = discharge."""


class DemandSource(Checkpointed, ABC):
    """Returns the demand of a step and its forecast; its state is part of a checkpoint."""

    demand_depends_on_soc = False
    """See :class:`bess.control.policies.PolicyInput`."""

    @abstractmethod
    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """Return the demand [kW] of ``step`` (binding) and the forecast of the next ones, ``(horizon,)``.

        Called once for each step, in order. After the last step of the run the forecast is zero.
        """

    def planned(self, step: int) -> dict[str, float]:
        """Return planned values of ``step`` by record name, after :meth:`ahead`; empty without a plan."""
        return {}

    def block(self, step: int, most: int, horizon: int, now: StepInputs) -> Array:
        """Return :meth:`ahead` of ``step`` and the next ones, ``(n_steps, horizon)``.

        It covers at most ``most`` steps that do not depend on measurements after ``now``, with the same
        inverters in service.
        """
        return self.ahead(step, horizon, now)[None]

    def measured(self, step: int, soc: Array, soh_capacity: Array) -> None:
        """Record the states at the start of ``step``, a later step of the last :meth:`block`."""


def padded(values: Array, horizon: int) -> Array:
    """Pad the series with zero demand."""
    return np.concatenate([values, np.zeros(horizon - values.size)])
