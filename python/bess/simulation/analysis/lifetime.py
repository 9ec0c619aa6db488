"""Ageing and long runs: yearly ledger, net present value, budgets of a year, and contract figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bess.arrays import finite_array, one_number
from bess.errors import InputError
from bess.simulation.analysis.settlement import has_prices, recorded_terms, settled
from bess.simulation.record.dataset import seconds, study_of, with_initial
from bess.simulation.record.result import Result, record_of
from bess.study.grid import TimeGrid, seconds_of
from bess.study.sections import BudgetSection
from bess.units import DAYS_PER_YEAR, KWH_PER_MWH, PERCENT

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def ledger_by_year(result: Result | xr.Dataset) -> pd.DataFrame:
    """Return the ledger summed over years of operation.

    Parameters
    ----------
    result
        A result or record with prices.

    Returns
    -------
    pandas.DataFrame
        One row for each year, from 1, and one column for each entry of
        :func:`bess.simulation.analysis.ledger` [EUR]. A year lasts from the start of the run to the same day
        and hour of the next year; the last may be a part of one.

    Raises
    ------
    InputError
        If the record has no prices.
    """
    import pandas as pd

    dataset = record_of(result, "ledger_by_year")
    entries, grid = settled(dataset), TimeGrid.of_record(dataset)
    years = np.searchsorted(grid.years, np.arange(grid.n_steps), side="right")
    return pd.DataFrame(entries).groupby(pd.Index(years, name="year")).sum()


def cash_by_year(result: Result | xr.Dataset) -> pd.DataFrame:
    """Return the cash flow of years of operation: batteries are paid when installed, not as they wear.

    The batteries of the start are paid for. At the end of the run, a battery in service is worth the share of
    its cost that is left until its end of life: of what was paid for it in the run, or of the replacement
    cost for a battery of the start. A string that will be retired, or has not been added yet, is worth
    nothing.

    Parameters
    ----------
    result
        A result or record with prices, of strings with a cell model.

    Returns
    -------
    pandas.DataFrame
        One row for each year, from 1 [EUR]: ``income_eur`` is ``net_eur`` without wear cost,
        ``investment_eur`` the cost of replacements and augmentations, ``residual_eur`` the value at the end
        of the run, and ``cash_eur`` income - investment + residual value.

    Raises
    ------
    InputError
        If the record has no prices.
    """
    import pandas as pd

    dataset = record_of(result, "cash_by_year")
    ledger = ledger_by_year(dataset)
    end_of_life, eur_per_soh = (
        np.array(dataset.attrs[name], ndmin=1) for name in ("end_of_life_soh", "residual_eur_per_soh")
    )
    if "investment_eur" in dataset:
        for string, paid_eur in enumerate(dataset["investment_eur"].values.T):
            if paid_eur.any() and eur_per_soh[string] > 0.0:
                eur_per_soh[string] = paid_eur[np.flatnonzero(paid_eur)[-1]] / (1.0 - end_of_life[string])
    residual = np.maximum(dataset["soh_capacity"].values[-1] - end_of_life, 0.0) * eur_per_soh
    added_s: dict[int, int] = {}  # the first augmentation of each string
    for table in study_of(dataset).get("augmentation", ()):
        date_s, string = seconds_of(table["date"]), table["string"]
        added_s[string] = min(date_s, added_s.get(string, date_s))
    residual[[string for string, date_s in added_s.items() if date_s > seconds(dataset)[-1]]] = 0.0
    frame = pd.DataFrame({"income_eur": ledger["net_eur"] + ledger["wear_eur"]})
    frame["investment_eur"] = ledger.get("investment_eur", 0.0)
    frame["residual_eur"] = np.where(frame.index == frame.index[-1], residual.sum(), 0.0)
    frame["cash_eur"] = frame["income_eur"] - frame["investment_eur"] + frame["residual_eur"]
    return frame


def net_present_value(amounts: ArrayLike, discount_rate: float, last_year: float = 1.0) -> float:
    r"""Return the net present value of amounts at the ends of years: :math:`\sum_k a_k (1 + r)^{-k}`.

    Parameters
    ----------
    amounts
        One amount for each year, such as ``ledger_by_year(result)["net_eur"]``.
    discount_rate
        Per year, above -1; 0.05 for 5 %.
    last_year
        Share of the last year after which its amount is due, in (0, 1].

    Raises
    ------
    InputError
        If the rate is -1 or less, an amount is not finite, or the share is outside its range.
    """
    values, rate = np.atleast_1d(finite_array("amounts", amounts)), one_number("discount_rate", discount_rate)
    last = one_number("last_year", last_year)
    if values.ndim > 1:
        raise InputError(f"amounts have shape {values.shape}; give one amount for each year")
    if rate <= -1.0:
        raise InputError(f"discount_rate {rate:g}: must be above -1")
    if not 0.0 < last <= 1.0:
        raise InputError(f"last_year {last:g}: must be in (0, 1]")
    years = np.arange(1.0, values.size + 1.0)
    years[-1:] -= 1.0 - last
    return math.fsum(values / (1.0 + rate) ** years)


def wear_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Yield the state of health at the end, days to the first end of life, and the net present value."""
    if "soh_capacity" not in dataset:  # as in a dataset of the user
        return
    capacity, resistance = (dataset[name].values[-1] for name in ("soh_capacity", "soh_resistance"))
    yield "soh_capacity_min", capacity.min()
    yield "soh_capacity_mean", capacity.mean()
    yield "soh_resistance_max", resistance.max()
    step_h = float(dataset.attrs["step_h"])
    days = dataset.sizes["time"] * step_h / 24.0
    if "end_of_life" in dataset:
        steps = np.flatnonzero(dataset["end_of_life"].values.any(axis=1))
        if steps.size:
            yield "end_of_life_days", (steps[0] + 1) * step_h / 24.0
    if "cyclic_loss" in dataset:
        aged = np.maximum(np.diff(with_initial(dataset, "cyclic_loss"), axis=0), 0.0).sum(axis=0)
        discharged_kwh = np.maximum(dataset["delivered_kw"].values, 0.0).sum() * step_h
        if discharged_kwh > 0.0:
            wear_eur = float(aged @ np.ravel(dataset.attrs["wear_eur_per_loss"]))
            yield "cycle_wear_eur_mwh", wear_eur * KWH_PER_MWH / discharged_kwh
    if "investment_eur" in dataset:
        yield "investment_eur", math.fsum(dataset["investment_eur"].values.ravel())
    if has_prices(dataset):
        if days > DAYS_PER_YEAR:
            terms = recorded_terms(dataset).discount_rate, float(TimeGrid.of_record(dataset).year_shares[-1])
            yield "npv_eur", net_present_value(ledger_by_year(dataset)["net_eur"], *terms)
            if "cyclic_loss" in dataset:
                yield "cash_npv_eur", net_present_value(cash_by_year(dataset)["cash_eur"], *terms)
    else:
        yield "wear_eur", math.fsum(dataset["wear_eur"].values.ravel())


def budget_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Yield the largest used share of a yearly budget, for studies with ``[budget]``.

    A partly simulated year has a proportional budget. Full cycles and throughput are those of
    :class:`bess.dispatch.CycleBudget`.
    """
    if "budget_cycles" not in dataset:
        return
    limits = BudgetSection.model_validate(study_of(dataset)["budget"])
    step_h = float(dataset.attrs["step_h"])
    grid = TimeGrid.of_record(dataset)
    first, part = grid.years[:-1], grid.year_shares
    nominal_kwh = np.ravel(dataset.attrs["nominal_energy_kwh"])
    change_kwh = np.diff(with_initial(dataset, "soc"), axis=0) * dataset["soh_capacity"].values * nominal_kwh
    charged, discharged = (
        np.add.reduceat(np.maximum(sign * change_kwh, 0.0).sum(axis=1), first) / nominal_kwh.sum()
        for sign in (1.0, -1.0)
    )
    sold_mwh = np.maximum(dataset["delivered_kw"].values, 0.0).sum(axis=1) * step_h / KWH_PER_MWH
    used = [
        (values / (part * limit)).max()
        for values, limit in (
            (np.maximum(charged, discharged), limits.cycles_per_year),
            (np.add.reduceat(sold_mwh, first), limits.throughput_mwh_per_year),
        )
        if limit is not None
    ]
    yield "budget_used_pct", PERCENT * float(max(used))


_MARGINS = {"round_trip_efficiency_pct": "round_trip_efficiency_pct", "availability_pct": "fulfilment_pct"}
"""Keys of the contract, and the KPIs that they guarantee."""


def contract_kpis(dataset: xr.Dataset, kpis: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Yield the margins of a run over its guarantees, and the remaining throughput of the contract."""
    contract = study_of(dataset).get("contract", {})
    for key, name in _MARGINS.items():
        if key in contract and name in kpis:
            yield f"contract_{key.removesuffix('_pct')}_margin", kpis[name] - contract[key]
    if "throughput_mwh" in contract:
        used_mwh = kpis["discharged_kwh"] / KWH_PER_MWH
        yield "contract_throughput_left_mwh", contract["throughput_mwh"] - used_mwh
