"""Export of the record of a run as a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bess.cli.choices import Format
from bess.edge.plant_io.journal import is_journal, open_journal
from bess.errors import InputError
from bess.optional_dependencies import extra
from bess.simulation.record import open_result, scenario_directories
from bess.simulation.record.atomic import replacing

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def export(directory: Path, kind: Format) -> list[Path]:
    """Write ``record.csv`` or ``record.parquet`` next to every record in a folder.

    The table has one row per step, ``time`` in UTC, and one column per string or node, such as
    ``delivered_kw.0`` or ``node_temperature_c.0.15``. The folder is of runs or of a plant journal.

    Raises
    ------
    InputError
        If the folder has no run, or the Parquet library is not installed.
    """
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
            frame = table_of(dataset)
        with replacing(path) as temporary:
            if kind is Format.CSV:
                whole = (frame["time"].dt.microsecond == 0).all()
                seconds = "%S" if whole else "%S.%f"
                frame.to_csv(temporary, index=False, date_format=f"%Y-%m-%dT%H:%M:{seconds}Z")
            else:
                with extra("market", "a Parquet file"):
                    frame.to_parquet(temporary, index=False)
        written.append(path)
    return written


def table_of(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a record as a table with one row per step."""
    import pandas as pd

    columns: dict[str, object] = {"time": pd.DatetimeIndex(dataset["time"].values, tz="UTC")}
    for name, variable in dataset.data_vars.items():
        values = variable.values
        for index in np.ndindex(*values.shape[1:]):
            columns[".".join([str(name), *map(str, index)])] = values[(slice(None), *index)]
    return pd.DataFrame(columns)
