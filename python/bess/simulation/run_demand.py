"""What a demand gives a run: its control steps, what is asked in each, and what is recorded beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bess.numbers import Array
from bess.simulation.demand import DemandSource
from bess.study.grid import Grid

if TYPE_CHECKING:
    import pandas as pd


DEFAULT_START: Final = datetime(2024, 1, 1, tzinfo=UTC)
"""When a run starts whose demand names no time."""


@dataclass(frozen=True)
class RunDemand:
    """Demand of a run.

    Attributes
    ----------
    grid : Grid
        Control steps of the run.
    source : DemandSource
        What is asked in each.
    price_eur_mwh : ndarray, shape (n_steps,), or None
        Price of energy, of studies that have one.
    files : list of Path
        Files that were read.
    notes : list of str
        What was found in them, for people.
    series : dict of ndarray, shape (n_steps,)
        What else is known of each step, by names of the record.
    """

    grid: Grid
    source: DemandSource
    price_eur_mwh: Array | None = None
    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    series: Mapping[str, Array] = field(default_factory=dict)


def utc_index(grid: Grid) -> pd.DatetimeIndex:
    """Start of each step as an index in UTC."""
    import pandas as pd

    return pd.DatetimeIndex(grid.times).tz_localize("UTC")


def repair_notes(series: pd.Series[float]) -> list[str]:
    """What a reader changed in a file, a sentence each."""
    return [f"repaired: {repair}" for repair in series.attrs.get("repairs", ())]
