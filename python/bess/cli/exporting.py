"""The record of a run as a plain table, for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bess.cli.app import Format
from bess.errors import InputError
from bess.extras import extra
from bess.record import open_result, scenario_directories
from bess.record.atomic import replacing

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def export(directory: Path, kind: Format) -> list[Path]:
    """Write ``record.csv`` or ``record.parquet`` beside the record of every run in a folder; return them.

    One row for each step, ``time`` in UTC; a variable of strings has one column for each, such as
    ``delivered_kw.0``, one of nodes ``node_temperature_c.0.15``.

    Raises
    ------
    InputError
        If there is no run, or the library that writes Parquet is not installed.
    """
    folders = scenario_directories(directory)
    if not folders:
        raise InputError(f"{directory}: holds no run; bess export needs the folder of bess run or bess sweep")
    written = []
    for folder in folders.values():
        path = folder / f"record.{kind}"
        with open_result(folder) as dataset:
            frame = table_of(dataset)
        with replacing(path) as temporary:
            if kind is Format.CSV:
                frame.to_csv(temporary, index=False, date_format="%Y-%m-%dT%H:%M:%SZ")
            else:
                with extra("market", "a Parquet file"):
                    frame.to_parquet(temporary, index=False)
        written.append(path)
    return written


def table_of(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a record as a table of one row for each step."""
    import pandas as pd

    columns: dict[str, object] = {"time": pd.DatetimeIndex(dataset["time"].values, tz="UTC")}
    for name, variable in dataset.data_vars.items():
        values = variable.values
        for index in np.ndindex(*values.shape[1:]):
            columns[".".join([str(name), *map(str, index)])] = values[(slice(None), *index)]
    return pd.DataFrame(columns)
