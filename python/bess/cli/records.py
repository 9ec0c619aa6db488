"""Runs on disk for commands: names of the runs to compare, their KPIs as text, and export as a table."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from bess.errors import InputError
from bess.optional_dependencies import extra
from bess.report.runs import Run, runs_in
from bess.simulation.analysis.catalogue import KpisByRun, grouped, kpi
from bess.simulation.record import open_result, scenario_directories
from bess.simulation.record.files import REPEAT, clear_errors, replacing

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def runs_of(directories: Iterable[Path]) -> dict[str, Run]:
    """Return the runs of all folders by name; runs of the same name get their folder as a prefix."""
    found = [
        (directory, name, run) for directory in directories for name, run in runs_in(directory)[0].items()
    ]
    if len({run.directory.resolve() for *_, run in found}) < 2:
        raise InputError(
            "bess compare needs at least two runs: specify two folders, or one folder with several scenarios"
        )
    names = [name for _, name, _ in found]
    runs: dict[str, Run] = {}
    for directory, name, run in found:
        shown = name
        if names.count(name) > 1:
            shown = directory.name if run.directory == directory else f"{directory.name}/{name}"
        if shown in runs:
            shown = str(run.directory)
        runs[shown] = run
    return runs


def kpi_table(kpis: KpisByRun) -> str:
    """Return a table with one column per run and grouped rows, without missing KPIs and details."""
    table = Table("", "", box=None, pad_edge=False)
    for run in kpis:
        table.add_column(Text(run), justify="right", header_style="")
    shown = (name for values in kpis.values() for name in values if not kpi(name).detail)
    for heading, names in grouped(shown).items():
        table.add_row(Text(heading))
        for name in names:
            entry = kpi(name)
            numbers = (entry.number(values.get(name, math.nan)) for values in kpis.values())
            table.add_row(*(Text(cell) for cell in (f"  {entry.label}", entry.unit, *numbers)))
    # Full width: a terminal may wrap the lines, a file keeps them.
    text = io.StringIO()
    Console(file=text, width=100_000, color_system=None).print(table)
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def export(directory: Path, kind: Literal["csv", "parquet"]) -> list[Path]:
    """Write ``record.csv`` or ``record.parquet`` next to every record in a folder.

    The table has one row per step, ``time`` in UTC, and one column per string or node, such as
    ``delivered_kw.0`` or ``node_temperature_c.0.15``. The folder is of runs or of a plant journal.
    """
    from bess.edge.plant_io.journal import is_journal, open_journal

    if is_journal(directory):
        folders, opened = {"": directory}, open_journal
    else:
        folders, opened = scenario_directories(directory), open_result
    if not folders:
        raise InputError(
            f"{directory}: contains no run; specify a folder of bess run, bess sweep or bess serve"
        )
    written = []
    for folder in folders.values():
        path = folder / f"record.{kind}"
        with opened(folder) as dataset:
            frame = _table(dataset)
        with clear_errors(path, REPEAT), replacing(path) as temporary:
            if kind == "csv":
                whole = (frame["time"].dt.microsecond == 0).all()
                seconds = "%S" if whole else "%S.%f"
                frame.to_csv(temporary, index=False, date_format=f"%Y-%m-%dT%H:%M:{seconds}Z")
            else:
                with extra("market", "a Parquet file"):
                    frame.to_parquet(temporary, index=False)
        written.append(path)
    return written


def _table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a record as a table with one row per step."""
    import pandas as pd

    columns: dict[str, object] = {"time": pd.DatetimeIndex(dataset["time"].values, tz="UTC")}
    for name, variable in dataset.data_vars.items():
        values = variable.values
        for index in np.ndindex(*values.shape[1:]):
            columns[".".join([str(name), *map(str, index)])] = values[(slice(None), *index)]
    return pd.DataFrame(columns)
