"""Demands of a site with load and generation behind one meter: peak shaving and self-consumption."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from bess.arrays import Array
from bess.dispatch import SITES, Forecast, GridPowerTarget, PeakTariff, StorageEstimator, min_peak_kw
from bess.dispatch.connection import QUARTER_S
from bess.display import rounded
from bess.errors import InputError
from bess.files import Fill
from bess.study.demands.source import (
    DemandSection,
    DemandSource,
    Efficiency,
    RunDemand,
    Setting,
    StepInputs,
    forecast_of,
    padded,
)
from bess.study.grid import TimeGrid
from bess.study.sections import TimeZone
from bess.system.quantities import Fraction, NonNegative, Positive, Price
from bess.system.section import Section

_MIN_SHARE = 0.03
"""Minimum power, as a share of plant power: lower powers do not justify the no-load loss of an inverter."""


class MeterSection(Section):
    """Load and generation behind one meter with the plant, and the tariff of its peak.

    ``load`` and ``pv`` are bundled (``industrial-week``, ``commercial-week``, ``solar-week``) or files as
    :func:`bess.dispatch.read_profile` reads them, positive for consumption and generation;
    ``repeat`` repeats both. ``peak_eur_kw_month`` is the price of the highest quarter-hour mean of the grid
    import in each calendar month of ``billing_time_zone``; a month that the run covers in part is charged in
    full.
    """

    load: str | None = None
    column: str | None = None
    scale: Positive = 1.0
    pv: str | None = None
    pv_column: str | None = None
    pv_scale: Positive = 1.0
    unit: Literal["kW", "W", "MW"] = "kW"
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    peak_eur_kw_month: Positive | None = None
    billing_time_zone: TimeZone = "Europe/Berlin"
    forecast: Literal["perfect", "persistence"] = "perfect"


class SiteDemand(MeterSection, DemandSection):
    """Load and optional generation behind one meter with the plant, at constant prices.

    ``price_eur_mwh`` is the grid import price, ``export_price_eur_mwh`` the export
    price. The forecast of the demand depends on the forecast of load and generation and on the round-trip
    efficiency: initially ``efficiency``, later the measured value.
    """

    files: ClassVar = ("load", "pv")

    kind: Literal["peak-shaving", "self-consumption"]
    load: str
    efficiency: Efficiency = 0.9
    ready_soc: Fraction = 1.0
    price_eur_mwh: Price = 250.0
    export_price_eur_mwh: Price = 80.0

    def build(self, setting: Setting) -> RunDemand:
        """See :class:`~bess.study.demands.source.DemandSection`."""
        site = site_of(self, setting)
        grid, store = site.grid, StorageEstimator(setting.system, self.efficiency)
        power_kw = float(setting.system.nominal_kw.sum())
        capacity_kwh = store.capacity_kwh(setting.system.initial_state(), self.ready_soc)
        target = GridPowerTarget(0.0, power_kw, capacity_kwh, store.one_way_efficiency, grid.dt_h)
        series = site.series | {"export_price_eur_mwh": np.full(grid.n_steps, self.export_price_eur_mwh)}
        target_kw, more_series = self._limit(setting, site, store, target)
        source = MeterSource(site.forecast, target, target_kw, store, self.ready_soc)
        return RunDemand(grid, source, np.full(grid.n_steps, self.price_eur_mwh), series | more_series)

    def _limit(
        self, setting: Setting, site: Site, store: StorageEstimator, target: GridPowerTarget
    ) -> tuple[Array, dict[str, Array]]:
        """Return the target of the grid power in each step [kW], and series to record."""
        return np.zeros(site.grid.n_steps), {}


class PeakShavingDemand(SiteDemand):
    """Section ``[demand]`` with ``kind = "peak-shaving"``: limit on the grid import.

    The plant supplies the load above ``limit_kw`` and charges up to ``ready_soc`` with the remaining power
    below it. By default, ``limit_kw`` is the lowest limit that is feasible with perfect foresight and twice
    the losses (:func:`bess.dispatch.min_peak_kw`): a plant that becomes empty within a peak loses all of the
    reduction, and one that keeps energy in reserve a small part of it. A kW of reduced peak import saves
    ``demand_charge_eur_kw_year``, in proportion to the length of the run; with ``peak_eur_kw_month``, each
    month has a limit of its own, and its price replaces that of the year.
    """

    kind: Literal["peak-shaving"] = "peak-shaving"
    load: str = "industrial-week"
    limit_kw: Positive | None = None
    demand_charge_eur_kw_year: NonNegative = 100.0

    def _limit(
        self, setting: Setting, site: Site, store: StorageEstimator, target: GridPowerTarget
    ) -> tuple[Array, dict[str, Array]]:
        n_steps = site.grid.n_steps
        if self.limit_kw is None:
            target_kw = min_peak_kw(
                site.net_kw,
                site.grid.dt_h,
                power_kw=target.power_kw,
                capacity_kwh=target.capacity_kwh,
                stored_kwh=store.stored_kwh(setting.system.initial_state()),
                one_way_efficiency=store.one_way_efficiency**2,
                month=0 if site.tariff is None else site.tariff.month,
            )
        else:
            target_kw = np.full(n_steps, self.limit_kw)
        found = "as given" if self.limit_kw else "the minimum with perfect forecast and twice the losses"
        limits = " and ".join(rounded(each, 4) for each in dict.fromkeys(target_kw.tolist()))
        setting.note(f"limit of the grid connection: {limits} kW, {found}")
        series = {"grid_limit_kw": target_kw}
        if site.tariff is None:
            series["demand_charge_eur_kw_h"] = np.full(n_steps, self.demand_charge_eur_kw_year / 8760.0)
        return target_kw, series


class SelfConsumptionDemand(SiteDemand):
    """Section ``[demand]`` with ``kind = "self-consumption"``: store surplus generation for the load.

    The plant charges surplus generation up to ``ready_soc`` and discharges when generation is below the load.
    """

    kind: Literal["self-consumption"] = "self-consumption"
    load: str = "commercial-week"
    pv: str | None = "solar-week"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pv is None:
            raise ValueError("self-consumption requires generation: set pv to a generation profile")
        return self


@dataclass(eq=False)
class MeterSource(DemandSource):
    """A battery that keeps the power at the meter at a target (:class:`~bess.dispatch.GridPowerTarget`)."""

    _carried = ("store",)
    demand_depends_on_soc = True

    net_kw: Forecast
    target: GridPowerTarget
    target_kw: Array
    store: StorageEstimator
    ready_soc: float

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        state = now.state
        self.store.update(state, now.delivered_kw * self.target.dt_h)
        net_kw = self.net_kw.ahead(step, horizon)
        power_kw = min(self.target.power_kw, float(now.limit_kw.sum()))
        target = replace(
            self.target,
            target_kw=self.target_kw[step : step + net_kw.size],
            one_way_efficiency=self.store.one_way_efficiency,
            power_kw=power_kw,
            min_power_kw=_MIN_SHARE * power_kw,
            capacity_kwh=self.store.capacity_kwh(state, self.ready_soc, now.limit_kw),
        )
        return padded(target.demand_kw(net_kw, self.store.stored_kwh(state, now.limit_kw)), horizon)


@dataclass(frozen=True)
class Site:
    """Load and generation behind the meter of a plant."""

    grid: TimeGrid
    """Control steps of the run."""
    net_kw: Array
    """Load minus generation."""
    forecast: Forecast
    """Forecast of ``net_kw``."""
    tariff: PeakTariff | None
    """Price of the peak."""
    series: dict[str, Array]
    """``(n_steps,)``: recorded series, by variable name."""


def site_of(meter: MeterSection, setting: Setting, grid: TimeGrid | None = None) -> Site:
    """Read load and generation; without ``grid``, the load determines the time span of the run."""
    place = "demand" if grid is None else "demand.meter"
    power_kw: dict[str, Array] = {}
    for key, name, column, scale in (
        ("load", meter.load, meter.column, meter.scale),
        ("pv", meter.pv, meter.pv_column, meter.pv_scale),
    ):
        if name is None:
            continue
        reading = meter.model_dump(include={"unit", "time_zone", "fill"})
        given = setting.power_of(name, f"{place}.{key}", SITES, scale=scale, column=column, **reading)
        low, high = given.values.min(), given.values.max()
        setting.note(f"{key}: {given.what}, {rounded(low, 4)} to {rounded(high, 4)} kW", given)
        grid = grid or setting.grid_of(given)
        power_kw[key] = given.on(grid, repeat=meter.repeat)
    assert grid is not None
    n = grid.n_steps
    load_kw, pv_kw = (power_kw.get(key, np.zeros(n)) for key in ("load", "pv"))
    series = {"load_kw": load_kw, "generation_kw": pv_kw}
    tariff = None
    if meter.peak_eur_kw_month is not None:
        tariff = _tariff(meter.peak_eur_kw_month, meter.billing_time_zone, grid, place)
        series["peak_price_eur_kw"] = np.full(n, tariff.eur_kw)
        series["billing_month"] = tariff.month.astype(np.float64)
    forecast = forecast_of(meter.forecast, load_kw - pv_kw, grid.dt_h)
    return Site(grid, load_kw - pv_kw, forecast, tariff, series)


def _tariff(eur_kw: float, time_zone: str, grid: TimeGrid, place: str) -> PeakTariff:
    if QUARTER_S % grid.step_s:
        raise InputError(
            f"{place}.peak_eur_kw_month: a control step of {grid.step_s / 60:g} min does not divide "
            "a quarter of an hour, over which the peak is averaged; set system.parameters.control.step_min"
        )
    local = grid.index.tz_convert(time_zone)
    quarter = (grid.start_s + grid.step_s * np.arange(grid.n_steps)) // QUARTER_S
    return PeakTariff(eur_kw, np.asarray(100 * local.year + local.month, dtype=np.int64), quarter)
