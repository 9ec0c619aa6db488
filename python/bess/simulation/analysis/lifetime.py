"""Long runs: yearly ledger, net present value, and ageing of the strings."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.errors import InputError
from bess.simulation.analysis.settlement import has_prices, ledger, recorded_terms
from bess.units import DAYS_PER_YEAR, KWH_PER_MWH

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from bess.simulation.record import Result


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

    entries = ledger(result)
    time = pd.DatetimeIndex(entries["time"].values)
    starts = [time[0]]
    while starts[-1] <= time[-1]:
        starts.append(time[0] + pd.DateOffset(years=len(starts)))
    years = np.searchsorted(np.array(starts, dtype=time.values.dtype), time.values, side="right")
    frame = pd.DataFrame({str(name): entries[name].values for name in entries.data_vars})
    return frame.groupby(pd.Index(years, name="year")).sum()


def cash_by_year(result: Result | xr.Dataset) -> pd.DataFrame:
    """Return the cash flow of years of operation: batteries are paid when installed, not as they wear.

    The batteries of the start are paid for. At the end of the run, a battery in service is worth the share of
    its replacement cost that is left until its end of life; a string that will be retired is worth nothing.

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

    dataset: Any = getattr(result, "dataset", result)
    ledger = ledger_by_year(dataset)
    left = dataset["soh_capacity"].values[-1] - np.ravel(dataset.attrs["end_of_life_soh"])
    residual = np.maximum(left, 0.0) * np.ravel(dataset.attrs["residual_eur_per_soh"])
    frame = pd.DataFrame({"income_eur": ledger["net_eur"] + ledger["wear_eur"]})
    frame["investment_eur"] = ledger.get("investment_eur", 0.0)
    frame["residual_eur"] = np.where(frame.index == frame.index[-1], residual.sum(), 0.0)
    frame["cash_eur"] = frame["income_eur"] - frame["investment_eur"] + frame["residual_eur"]
    return frame


def net_present_value(amounts: ArrayLike, discount_rate: float) -> float:
    r"""Return the net present value of amounts at the ends of years: :math:`\sum_k a_k (1 + r)^{-k}`.

    Parameters
    ----------
    amounts
        One for each year, such as ``ledger_by_year(result)["net_eur"]``.
    discount_rate
        Per year, above -1; 0.05 for 5 %.

    Raises
    ------
    InputError
        If the rate is -1 or less, or an amount is not finite.
    """
    values: NDArray[np.float64] = np.asarray(amounts, dtype=np.float64).ravel()
    if not (discount_rate > -1.0 and math.isfinite(discount_rate) and np.isfinite(values).all()):
        raise InputError(
            f"discount_rate {discount_rate:g}: must be finite and above -1, and all amounts finite"
        )
    return math.fsum(values / (1.0 + discount_rate) ** np.arange(1, values.size + 1))


def wear_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Yield the state of health at the end, days to the first end of life, and the net present value."""
    if "soh_capacity" not in dataset:  # records made before strings could age
        return
    capacity, resistance = (dataset[name].values[-1] for name in ("soh_capacity", "soh_resistance"))
    yield "soh_capacity_min", capacity.min()
    yield "soh_capacity_mean", capacity.mean()
    yield "soh_resistance_max", resistance.max()
    days = dataset.sizes["time"] * float(dataset.attrs["step_h"]) / 24.0
    if "end_of_life" in dataset:
        steps = np.flatnonzero(dataset["end_of_life"].values.any(axis=1))
        if steps.size:
            yield "end_of_life_days", (steps[0] + 1) * float(dataset.attrs["step_h"]) / 24.0
    if "cyclic_loss" in dataset and "wear_eur_per_loss" in dataset.attrs:
        aged = np.maximum(np.diff(dataset["cyclic_loss"].values, axis=0), 0.0).sum(axis=0)
        discharged_kwh = np.maximum(dataset["delivered_kw"].values, 0.0).sum() * dataset.attrs["step_h"]
        if discharged_kwh > 0.0:
            wear_eur = float(aged @ np.ravel(dataset.attrs["wear_eur_per_loss"]))
            yield "cycle_wear_eur_mwh", wear_eur * KWH_PER_MWH / discharged_kwh
    if "investment_eur" in dataset:
        yield "investment_eur", math.fsum(dataset["investment_eur"].values.ravel())
    if has_prices(dataset):
        if days > DAYS_PER_YEAR:
            rate = recorded_terms(dataset).discount_rate
            yield "npv_eur", net_present_value(ledger_by_year(dataset)["net_eur"], rate)
            if "cyclic_loss" in dataset and "wear_eur_per_loss" in dataset.attrs:
                yield "cash_npv_eur", net_present_value(cash_by_year(dataset)["cash_eur"], rate)
    else:
        yield "wear_eur", math.fsum(dataset["wear_eur"].values.ravel())
