"""What services earn and how well they were kept, from the plant's record only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bess.numbers import Array
from bess.parameters.terms import Terms
from bess.units import PERCENT

if TYPE_CHECKING:
    import xarray as xr


_PER_MEGA: Final = 1000.0
_HELD: Final = 1.0 - 1e-9
"""Share of the reserve from which on it counts as sustained."""


def is_site(dataset: xr.Dataset) -> bool:
    """Tell whether the plant stands behind a meter with a load."""
    return "load_kw" in dataset


def is_reserve(dataset: xr.Dataset) -> bool:
    """Tell whether the plant gives frequency containment reserve."""
    return "response_kw" in dataset


def exchanged_kw(dataset: xr.Dataset) -> Array:
    """Return what is settled as energy [kW]: all that is delivered, less what answers the frequency.

    The response to frequency is taken out of the account of a plant, so what it delivers beside it is what it
    has bought or sold. Shape ``(n_steps, n_strings)``, or ``(n_steps, 1)`` with a reserve.
    """
    delivered: Array = np.asarray(dataset["delivered_kw"].values)
    if not is_reserve(dataset):
        return delivered
    beside: Array = delivered.sum(axis=1) - dataset["response_kw"].values
    return beside[:, None]


def site_saving_eur(dataset: xr.Dataset, terms: Terms) -> Array:
    """Return by how much the plant lowers what the meter costs in each step [EUR]; below 0 while it charges.

    What is drawn costs ``price_eur_mwh``, what is given earns ``export_price_eur_mwh``; fees are on what the
    plant charges and discharges.
    """
    step_mwh_per_kw = float(dataset.attrs["step_h"]) / _PER_MEGA
    before, after, delivered = draw_kw(dataset)
    drawn, given = dataset["price_eur_mwh"].values, dataset["export_price_eur_mwh"].values

    def bill(kw: Array) -> Array:
        return np.asarray(np.where(kw > 0.0, kw * drawn, kw * given))

    fees = np.where(
        delivered > 0.0, delivered * terms.discharge_fee_eur_mwh, -delivered * terms.charge_fee_eur_mwh
    )
    saving: Array = (bill(before) - bill(after) - fees) * step_mwh_per_kw
    return saving


def draw_kw(dataset: xr.Dataset) -> tuple[Array, Array, Array]:
    """Return what the meter draws without the plant and with it, and what the plant delivers [kW]."""
    delivered: Array = dataset["delivered_kw"].values.sum(axis=1)
    before: Array = np.asarray(dataset["load_kw"].values - dataset["generation_kw"].values)
    return before, before - delivered, delivered


def capacity_entries(dataset: xr.Dataset, terms: Terms) -> Iterator[tuple[str, Array]]:
    r"""Yield what kW, as opposed to kWh, earn and cost in each step [EUR].

    A reserve of `C` at the price :math:`\pi` earns :math:`C \pi\,\Delta t`. What of it the store could not
    sustain, or the plant did not answer, costs ``capacity_penalty`` times its price. At a meter with a demand
    charge it is the highest draw that is paid; what it is lower by is spread over the run.
    """
    dt_h = float(dataset.attrs["step_h"])
    if is_reserve(dataset):
        eur_per_kw = dataset["capacity_price_eur_mw_h"].values * (dt_h / _PER_MEGA)
        yield "capacity_revenue_eur", dataset["capacity_kw"].values * eur_per_kw
        yield "penalty_eur", terms.capacity_penalty * short_kw(dataset) * eur_per_kw
    elif "demand_charge_eur_kw_h" in dataset:
        before, after, _ = draw_kw(dataset)
        spared_kw = max(0.0, before.max()) - max(0.0, after.max())
        yield "capacity_revenue_eur", spared_kw * dataset["demand_charge_eur_kw_h"].values * dt_h


def short_kw(dataset: xr.Dataset) -> Array:
    """Return how much of the reserve was not there in each step [kW]."""
    capacity: Array = dataset["capacity_kw"].values
    lacking = capacity - dataset["capacity_able_kw"].values
    missed = np.abs(dataset["demand_kw"].values - dataset["delivered_kw"].values.sum(axis=1))
    missed[missed < (1.0 - _HELD) * capacity] = 0.0  # the delivered powers sum to the demand but for rounding
    short: Array = np.minimum(np.maximum(lacking, missed), capacity)
    return short


def service_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, Any]]:
    """Yield how well a service was kept; nothing of runs without one."""
    dt_h = float(dataset.attrs["step_h"])
    if is_reserve(dataset):
        sustained = dataset["capacity_able_kw"].values >= _HELD * dataset["capacity_kw"].values
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
    imported, exported = np.maximum(after, 0.0).sum() * dt_h, np.maximum(-after, 0.0).sum() * dt_h
    yield "import_kwh", imported
    yield "export_kwh", exported
    load, generated = (float(dataset[name].values.sum()) * dt_h for name in ("load_kw", "generation_kw"))
    if generated > 0.0:
        yield "self_consumption_pct", PERCENT * (1.0 - exported / generated)
        yield "self_sufficiency_pct", PERCENT * (1.0 - imported / load) if load > 0.0 else PERCENT
