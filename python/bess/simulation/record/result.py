"""Result of a run, and reading it from its directory."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bess.arrays import Array
from bess.display import as_table, one_line
from bess.errors import InputError, listed
from bess.files import path_of
from bess.optional_dependencies import extra
from bess.simulation.record.dataset import dataset_of
from bess.simulation.record.files import check_file
from bess.simulation.record.provenance import IDENTITY, read_identity
from bess.simulation.record.store import parts, read_record, records

if TYPE_CHECKING:
    import xarray as xr

    from bess.system import System

RESULTS = "results.nc"


@dataclass(frozen=True, eq=False)
class Result:
    """Outcome of :func:`bess.run`.

    Attributes
    ----------
    dataset : xarray.Dataset
        The record, as in ``ARCHITECTURE.md``; read lazily from ``directory`` if given.
    kpis : dict
        KPIs of :func:`bess.kpis`.
    directory : Path or None
        Folder of the run.
    solve_time_s : ndarray
        Wall-clock time of each solve [s]; not reproducible.
    system : System or None
        The simulated system.
    """

    dataset: xr.Dataset
    kpis: dict[str, float]
    directory: Path | None
    solve_time_s: Array = field(default_factory=lambda: np.zeros(0))
    system: System | None = None

    @cached_property
    def plot(self) -> Any:
        """Figures of this result; see :class:`bess.report.figures.Plot`. Needs the extra ``report``."""
        # The record does not depend on reports; this property imports them when needed.
        with extra("report", "a figure"):
            return import_module("bess.report.figures").Plot(self)

    def _facts(self) -> dict[str, str]:
        steps, strings = self.dataset.sizes["time"], self.dataset.sizes["string"]
        facts = {
            "title": str(self.dataset.attrs.get("title", "")),
            "steps": f"{steps:,} of {60.0 * float(self.dataset.attrs['step_h']):g} min",
            "strings": str(strings),
            "delivered": f"{self.kpis['delivered_kwh']:,.0f} of {self.kpis['demand_kwh']:,.0f} kWh",
            "lost": f"{self.kpis['lost_kwh']:,.0f} kWh",
        }
        if "net_eur" in self.kpis:
            facts["net"] = f"{self.kpis['net_eur']:,.0f} EUR"
        return facts | ({"folder": str(self.directory)} if self.directory else {})

    __repr__ = one_line
    _repr_html_ = as_table


def record_of(result: Result | xr.Dataset, place: str) -> xr.Dataset:
    """Return the record of a result, or the dataset given, with times along the first axis."""
    dataset: Any = getattr(result, "dataset", result)
    if "demand_kw" not in getattr(dataset, "data_vars", ()):
        raise InputError(
            f"{place} needs a result of bess.run or bess.open_result, or its dataset with demand_kw, not "
            f"{type(result).__name__}"
        )
    return dataset.transpose("time", "string", ..., missing_dims="ignore")  # type: ignore[no-any-return]


def open_result(directory: str | Path) -> xr.Dataset:
    """Open the record of a finished or unfinished run.

    The variables of a finished run are read when they are used. For an unfinished run, all complete parts are
    loaded.

    Parameters
    ----------
    directory
        ``out`` of the run, or the folder of a scenario in it.

    Raises
    ------
    InputError
        The folder contains no run, no saved steps, or several scenarios.
    """
    directory = path_of(directory, "folder")
    if (directory / RESULTS).exists():
        return open_netcdf(directory / RESULTS)
    identity = read_identity(directory)
    if identity is None:
        names = scenario_directories(directory)
        others = f"several runs; open one of {listed(names)}" if names else "no run"
        held = f"holds {others}" if directory.is_dir() else "no such folder"
        raise InputError(f"{directory}: {held}")
    saved = parts(directory)
    if not saved:
        raise InputError(f"{directory}: nothing has been saved yet; continue the run with resume")
    n_last = len(read_record(saved[-1])["demand_kw"])
    frame = identity["frame"] | {"n_steps": int(saved[-1].stem) + n_last}
    return dataset_of(frame, records(directory))


def scenario_directories(directory: str | Path) -> dict[str, Path]:
    """Return the folders of the runs in ``directory`` by name; a single run has the name of its study."""
    directory = path_of(directory, "folder")
    if (identity := read_identity(directory)) is not None:
        return {identity["study"]["name"]: directory}
    return {path.parent.name: path.parent for path in sorted(directory.glob(f"*/{IDENTITY}"))}


def open_netcdf(path: Path) -> xr.Dataset:
    """Open a results file lazily, after a check of its checksum if there is one."""
    import xarray as xr

    try:
        check_file(path)
        return xr.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError, KeyError, RuntimeError, TypeError) as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: is damaged ({what}); delete the folder and run the study again") from error
