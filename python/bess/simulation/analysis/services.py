"""Revenue and compliance of grid services, and the kind of a run, from the record of the plant only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bess.arrays import Array
from bess.dispatch.connection import QUARTER_S, PeakTariff, monthly_peaks_kw
from bess.simulation.record.dataset import seconds
from bess.system.terms import SettlementTerms
from bess.units import KWH_PER_MWH, PERCENT

if TYPE_CHECKING:
    import xarray as xr

    from bess.system import System


_MIN_SUSTAINED_SHARE: Final = 1.0 - 1e-9
"""Minimum share of the reserve that counts as sustained."""


def is_site(dataset: xr.Dataset) -> bool:
    """Whether the plant is behind a meter with a load."""
    return "load_kw" in dataset


def is_reserve(dataset: xr.Dataset) -> bool:
    """Whether the plant provides frequency containment reserve."""
    return "response_kw" in dataset


def exchanged_kw(dataset: xr.Dataset) -> Array:
    """Return the power that is settled as energy [kW]: delivered power minus the frequency response.

    The frequency response is excluded from the energy account of a plant. Shape ``(n_steps, n_strings)``, or
    ``(n_steps, 1)`` with a reserve.
    """
    delivered: Array = np.asarray(dataset["delivered_kw"].values)
    if not is_reserve(dataset):
        return delivered
    beside: Array = delivered.sum(axis=1) - dataset["response_kw"].values
    return beside[:, None]


def site_saving_eur(dataset: xr.Dataset, terms: SettlementTerms) -> Array:
    """Return the reduction of the energy cost at the meter in each step [EUR]; negative while charging.

    Grid import costs ``price_eur_mwh``, grid export earns ``export_price_eur_mwh``; fees apply to charged and
    discharged energy of the plant. Export above its limit is curtailed and earns nothing.
    """
    step_mwh_per_kw = float(dataset.attrs["step_h"]) / KWH_PER_MWH
    before, after, delivered = draw_kw(dataset)
    drawn, given = dataset["price_eur_mwh"].values, dataset["export_price_eur_mwh"].values

    max_export_kw = dataset["export_limit_kw"].values if "export_limit_kw" in dataset else np.inf

    def bill(kw: Array) -> Array:
        return np.asarray(np.where(kw > 0.0, kw * drawn, np.maximum(kw, -max_export_kw) * given))

    fees = np.where(
        delivered > 0.0, delivered * terms.discharge_fee_eur_mwh, -delivered * terms.charge_fee_eur_mwh
    )
    saving: Array = (bill(before) - bill(after) - fees) * step_mwh_per_kw
    return saving


def draw_kw(dataset: xr.Dataset) -> tuple[Array, Array, Array]:
    """Return the meter power without and with the plant, and the delivered power of the plant [kW]."""
    delivered: Array = dataset["delivered_kw"].values.sum(axis=1)
    before: Array = np.asarray(dataset["load_kw"].values - dataset["generation_kw"].values)
    return before, before - delivered, delivered


def capacity_entries(dataset: xr.Dataset, terms: SettlementTerms) -> Iterator[tuple[str, Array]]:
    r"""Yield revenue and cost of capacity (kW) in each step [EUR].

    A reserve of `C` at the price :math:`\pi` earns :math:`C \pi\,\Delta t`. Reserve that was not sustained or
    not delivered costs ``capacity_penalty`` times its price. With a demand charge, the reduction of the peak
    import is the revenue; it is distributed over the run.
    """
    dt_h = float(dataset.attrs["step_h"])
    if is_reserve(dataset):
        eur_per_kw = dataset["capacity_price_eur_mw_h"].values * (dt_h / KWH_PER_MWH)
        yield "capacity_revenue_eur", dataset["capacity_kw"].values * eur_per_kw
        yield "penalty_eur", terms.capacity_penalty * short_kw(dataset) * eur_per_kw
    elif "demand_charge_eur_kw_h" in dataset:
        before, after, _ = draw_kw(dataset)
        spared_kw = max(0.0, before.max()) - max(0.0, after.max())
        yield "capacity_revenue_eur", spared_kw * dataset["demand_charge_eur_kw_h"].values * dt_h


def peak_charge_eur(dataset: xr.Dataset) -> Array:
    """Return the increase of the monthly peak charge due to the plant in each step [EUR].

    The charge increases in each step that sets a new highest quarter-hour mean of the import, with the plant
    or without it.
    """
    month, price = dataset["billing_month"].values, dataset["peak_price_eur_kw"].values
    tariff = PeakTariff(float(price[0]), month, seconds(dataset) // QUARTER_S)
    before, after, _ = draw_kw(dataset)
    more_kw = monthly_peaks_kw(after, tariff) - monthly_peaks_kw(before, tariff)
    first = np.diff(month, prepend=month[0] - 1) != 0
    return np.asarray(price * np.where(first, more_kw, np.diff(more_kw, prepend=0.0)))


def short_kw(dataset: xr.Dataset) -> Array:
    """Return the insufficient reserve of each step [kW]."""
    capacity: Array = dataset["capacity_kw"].values
    lacking = capacity - dataset["capacity_able_kw"].values
    missed = np.abs(dataset["demand_kw"].values - dataset["delivered_kw"].values.sum(axis=1))
    # The delivered powers sum to the demand except for rounding.
    missed[missed < (1.0 - _MIN_SUSTAINED_SHARE) * capacity] = 0.0
    short: Array = np.minimum(np.maximum(lacking, missed), capacity)
    return short


def service_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, Any]]:
    """Yield the compliance KPIs of a service; none for runs without one."""
    dt_h = float(dataset.attrs["step_h"])
    if is_reserve(dataset):
        sustained = dataset["capacity_able_kw"].values >= _MIN_SUSTAINED_SHARE * dataset["capacity_kw"].values
        yield "outside_window_h", (~sustained).sum() * dt_h
        yield "response_kwh", np.abs(dataset["response_kw"].values).sum() * dt_h
    if is_site(dataset):
        yield from _site_kpis(dataset, dt_h)


def _site_kpis(dataset: xr.Dataset, dt_h: float) -> Iterator[tuple[str, Any]]:
    before, after, _ = draw_kw(dataset)
    yield "peak_before_kw", before.max()
    yield "peak_draw_kw", after.max()
    if "grid_limit_kw" in dataset:
        above = np.maximum(after - dataset["grid_limit_kw"].values, 0.0)
        yield "above_limit_kwh", above.sum() * dt_h
    max_export_kw = dataset["export_limit_kw"].values if "export_limit_kw" in dataset else np.inf
    imported, exported = np.maximum(after, 0.0).sum() * dt_h, np.clip(-after, 0.0, max_export_kw).sum() * dt_h
    if "export_limit_kw" in dataset:
        yield "curtailed_kwh", np.maximum(-after - max_export_kw, 0.0).sum() * dt_h
    yield "import_kwh", imported
    yield "export_kwh", exported
    load, generated = (float(dataset[name].values.sum()) * dt_h for name in ("load_kw", "generation_kw"))
    if generated > 0.0:
        surplus = np.maximum(-after, 0.0).sum() * dt_h
        yield "self_consumption_pct", PERCENT * (1.0 - surplus / generated)
        yield "self_sufficiency_pct", PERCENT * (1.0 - imported / load) if load > 0.0 else PERCENT


_UNPROVABLE: Final = {
    "reactive_kvar": "this run carried reactive power, which hindsight does not support; leave out "
    "[reactive] of its study",
    "investment_eur": "strings of this run are added, replaced or retired, which hindsight does not support",
}
"""Reasons why hindsight does not support a record, by a variable that only such records have."""


def unprovable(dataset: xr.Dataset, system: System) -> str | None:
    """Return the reason why :func:`bess.hindsight` does not support a run; None if it does."""
    reasons = (reason for name, reason in _UNPROVABLE.items() if name in dataset)
    return unbounded(system) or next(reasons, None)


def unbounded(system: System) -> str | None:
    """Return the reason why a system has no lower bound in hindsight; None if it has one."""
    if system.cooling is not None:
        return (
            f"{system.name} has [cooling] kind = {system.cooling.kind!r}; the lower bound supports "
            "ambient-air cooling only, without that section"
        )
    if any(string.battery.entropy or string.battery.hysteresis_heat for string in system.strings):
        return (
            f"{system.name} has battery.entropy or battery.hysteresis_heat; the lower bound supports ohmic "
            "heat only"
        )
    return None
