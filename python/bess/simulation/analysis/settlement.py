"""Revenue and cost of a run: a ledger in EUR from the record of the plant, without double counting."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.simulation.analysis.services import (
    capacity_entries,
    exchanged_kw,
    is_site,
    peak_charge_eur,
    site_saving_eur,
)
from bess.simulation.record.dataset import check_record, study_of
from bess.simulation.record.result import Result, record_of
from bess.system.terms import SettlementTerms
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import xarray as xr


REVENUES: Final = ("discharge_revenue_eur", "capacity_revenue_eur", "position_revenue_eur")
"""Entries of the ledger added to ``net_eur``; the second exists only for services paid for capacity, the
third with auctions before the last market."""

COSTS: Final = (
    *("charge_cost_eur", "shortfall_eur", "wear_eur", "start_eur", "auxiliary_eur"),
    *("penalty_eur", "peak_charge_eur"),
)
"""Subtracted entries; ``penalty_eur`` exists only for a reserve, ``peak_charge_eur`` with a peak tariff."""


def ledger(result: Result | xr.Dataset) -> xr.Dataset:
    r"""Return revenue and cost of every step [EUR].

    With price :math:`\pi`, delivered power :math:`p` (:math:`p^+` discharge, :math:`p^-` charge),
    demand :math:`D`, step :math:`\Delta t` and the terms of ``[settlement]``:

    - ``discharge_revenue_eur`` :math:`p^+ (\pi - f_d)\,\Delta t` and ``charge_cost_eur``
      :math:`p^- (\pi + f_c)\,\Delta t` with the fees :math:`f`; a negative price can make either negative;
    - ``shortfall_eur`` :math:`(|D| - |p|)(|\pi| + s)\,\Delta t`;
    - ``wear_eur``: wear cost from the wear model of the study;
    - ``investment_eur``, the cost of new batteries when installed, only for runs with replacement or
      augmentation; ``net_eur`` has the wear cost instead;
    - ``start_eur`` for each inverter start;
    - ``auxiliary_eur``: cost of grid import in addition to :math:`p` (cooling, and standby of inverters that
      are off), at the price and fee of charging;
    - ``capacity_revenue_eur`` for a reserve or a lower peak, and ``penalty_eur`` for insufficient reserve, in
      runs with services (:mod:`bess.simulation.analysis.services`);
    - ``position_revenue_eur``: auction positions at the auction price minus the price of the last market,
      which settles their repurchase and all delivered energy, imbalance included;
    - ``peak_charge_eur``: increase of the monthly peak charge due to the plant, in the steps that set a new
      highest import; negative if the plant lowers the charge;
    - ``net_eur``, the revenue minus all costs.

    With a reserve, `p` excludes the frequency response. Behind a meter, revenue and cost are the decrease of
    the meter cost by discharge and its increase by charge, and undelivered energy has no cost.

    Parameters
    ----------
    result
        A result or record with prices.

    Returns
    -------
    xarray.Dataset
        One variable for each entry, over ``time``. Costs are positive. The terms are in ``attrs``.

    Raises
    ------
    InputError
        The record has no prices.
    """
    import xarray as xr

    dataset = record_of(result, "ledger")
    return xr.Dataset(
        {name: ("time", values, {"units": "EUR"}) for name, values in settled(dataset).items()},
        {"time": dataset["time"]},
        recorded_terms(dataset).model_dump(),
    )


def settled(dataset: xr.Dataset) -> dict[str, Array]:
    """Return the entries of :func:`ledger` as plain arrays: to build a dataset, xarray imports Dask."""
    if not has_prices(dataset):
        raise InputError("settlement: the record has no prices (price_eur_mwh), as market studies have them")
    check_record(dataset, ("demand_kw", "delivered_kw", "inverter_starts"), "settlement")
    entries = dict(_entries(dataset, recorded_terms(dataset)))
    revenue, costs = ([entries[name] for name in names if name in entries] for names in (REVENUES, COSTS))
    return entries | {"net_eur": sum(revenue[1:], revenue[0]) - sum(costs[1:], costs[0])}


def has_prices(dataset: xr.Dataset) -> bool:
    """Whether a record can be settled."""
    return "price_eur_mwh" in dataset


def recorded_terms(dataset: xr.Dataset) -> SettlementTerms:
    """Return the settlement terms of a record."""
    return SettlementTerms.model_validate(study_of(dataset).get("settlement", {}))


def settlement_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Yield ``net_eur`` and the sums that form it, each with a single rounding."""
    entries = settled(dataset)
    revenues_eur, costs_eur = (
        {name: math.fsum(entries[name]) for name in names if name in entries} for names in (REVENUES, COSTS)
    )
    yield "net_eur", math.fsum(revenues_eur.values()) - math.fsum(costs_eur.values())
    yield from revenues_eur.items()
    yield from costs_eur.items()


def dispatch_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Yield the dispatch deviation between expected and delivered energy [kWh]."""
    dt_h = float(dataset.attrs["step_h"])
    expected_kw: Array = dataset["expected_kw"].values
    delivered_kw: Array = dataset["delivered_kw"].values.sum(axis=1)
    short_kw = np.maximum(np.abs(expected_kw) - np.sign(expected_kw) * delivered_kw, 0.0)
    yield "imbalance_kwh", np.abs(expected_kw - delivered_kw).sum() * dt_h
    yield "short_of_charge_kwh", short_kw[expected_kw < 0.0].sum() * dt_h
    yield "short_of_discharge_kwh", short_kw[expected_kw > 0.0].sum() * dt_h


def _entries(dataset: xr.Dataset, terms: SettlementTerms) -> Iterator[tuple[str, Array]]:
    step_mwh_per_kw = float(dataset.attrs["step_h"]) / KWH_PER_MWH
    price: Array = dataset["price_eur_mwh"].values
    charge_price = terms.charge_price_eur_mwh(price)
    if is_site(dataset):
        saving_eur = site_saving_eur(dataset, terms)
        discharges = dataset["delivered_kw"].values.sum(axis=1) > 0.0
        yield "discharge_revenue_eur", np.where(discharges, saving_eur, 0.0)
        yield "charge_cost_eur", np.where(discharges, 0.0, -saving_eur)
        yield "shortfall_eur", np.zeros_like(saving_eur)
    else:
        exchanged: Array = exchanged_kw(dataset)
        discharged_mwh = np.maximum(exchanged, 0.0).sum(axis=1) * step_mwh_per_kw
        charged_mwh = np.maximum(-exchanged, 0.0).sum(axis=1) * step_mwh_per_kw
        yield "discharge_revenue_eur", discharged_mwh * terms.discharge_price_eur_mwh(price)
        yield "charge_cost_eur", charged_mwh * charge_price
        asked_mwh = np.abs(dataset["demand_kw"].values) * step_mwh_per_kw
        delivered_mwh = np.abs(dataset["delivered_kw"].values).sum(axis=1) * step_mwh_per_kw
        # The delivered powers sum to the demand except for rounding: the difference may be slightly negative.
        missing_mwh = np.maximum(asked_mwh - delivered_mwh, 0.0)
        yield "shortfall_eur", missing_mwh * terms.shortfall_price_eur_mwh(price)
    yield from capacity_entries(dataset, terms)
    if "position_kw" in dataset:
        gained = dataset["auction_price_eur_mwh"].values - price[:, None]
        yield "position_revenue_eur", (dataset["position_kw"].values * gained).sum(axis=1) * step_mwh_per_kw
    if "peak_price_eur_kw" in dataset:
        yield "peak_charge_eur", peak_charge_eur(dataset)
    # Older records do not separate wear and standby.
    yield "wear_eur", _of_all_strings(dataset, "wear_eur")
    if "investment_eur" in dataset:  # not part of the net income, which has the wear cost
        yield "investment_eur", _of_all_strings(dataset, "investment_eur")
    yield "start_eur", dataset["inverter_starts"].values.sum(axis=1) * terms.start_eur
    standby_mwh = _of_all_strings(dataset, "standby_kw") * step_mwh_per_kw
    cooling_mwh = dataset["auxiliary_kw"].values * step_mwh_per_kw if "auxiliary_kw" in dataset else 0.0
    yield "auxiliary_eur", (standby_mwh + cooling_mwh) * charge_price


def _of_all_strings(dataset: xr.Dataset, name: str) -> Array:
    if name not in dataset:
        return np.zeros(dataset.sizes["time"])
    return np.asarray(dataset[name].values.sum(axis=1))
