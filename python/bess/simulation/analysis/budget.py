"""Use of the yearly cycle or throughput budget of a run, from its record."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from bess.study.grid import TimeGrid
from bess.study.sections import BudgetSection
from bess.units import KWH_PER_MWH, PERCENT

if TYPE_CHECKING:
    import xarray as xr


def budget_kpis(dataset: xr.Dataset) -> Iterator[tuple[str, float]]:
    """Yield the largest used share of a yearly budget, for studies with ``[budget]``.

    A partly simulated year has a proportional budget. Full cycles are the larger of charged and discharged
    SOC, mean over the strings; throughput is discharged energy (AC).
    """
    if "budget_cycles" not in dataset:
        return
    limits = BudgetSection.model_validate(tomllib.loads(dataset.attrs["study"])["budget"])
    step_h = float(dataset.attrs["step_h"])
    start_s = int(dataset["time"].values[0].astype("datetime64[s]").astype(np.int64))
    grid = TimeGrid(start_s, round(3600.0 * step_h), dataset.sizes["time"])
    years = np.minimum(grid.years, grid.n_steps)
    part = np.diff(years) / np.diff(grid.years)
    initial = np.atleast_1d(np.asarray(dataset.attrs["initial_soc"], dtype=np.float64))
    change = np.diff(dataset["soc"].values, axis=0, prepend=initial[None])
    charged, discharged = (
        np.add.reduceat(np.maximum(sign * change, 0.0).mean(axis=1), years[:-1]) for sign in (1.0, -1.0)
    )
    sold_mwh = np.maximum(dataset["delivered_kw"].values, 0.0).sum(axis=1) * step_h / KWH_PER_MWH
    used = [
        (values / (part * limit)).max()
        for values, limit in (
            (np.maximum(charged, discharged), limits.cycles_per_year),
            (np.add.reduceat(sold_mwh, years[:-1]), limits.throughput_mwh_per_year),
        )
        if limit is not None
    ]
    yield "budget_used_pct", PERCENT * float(max(used))
