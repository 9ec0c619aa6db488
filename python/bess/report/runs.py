"""What a report reads from a directory: its runs, their KPIs and logs, and whether they are complete."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bess.errors import BessError, InputError
from bess.record.identity import read_identity
from bess.record.result import RESULTS, open_result, scenario_directories
from bess.record.steplog import LOG

if TYPE_CHECKING:
    import xarray as xr

    from bess.parameters import System


_ALWAYS = frozenset(("demand_kwh", "charged_kwh", "undelivered_kwh", "lost_kwh"))
"""Figures that every record has; a run saved before they were introduced gets them from its record."""


@dataclass(frozen=True)
class Run:
    """One run on disk; the record is read when it is first used.

    Attributes
    ----------
    name : str
        Of the scenario, or of the study.
    directory : Path
        Where it is stored.
    identity : dict
        Version, study as resolved, system document, hashes of data files.
    """

    name: str
    directory: Path
    identity: dict[str, Any]

    @property
    def finished(self) -> bool:
        """Whether the run reached its end."""
        return (self.directory / RESULTS).exists()

    @property
    def study(self) -> dict[str, Any]:
        """The study as resolved."""
        study: dict[str, Any] = self.identity["study"]
        return study

    @property
    def study_toml(self) -> str:
        """The study as resolved, as it was saved."""
        try:
            return (self.directory / "study.toml").read_text(encoding="utf-8", errors="replace")
        except OSError:
            return "(the file is missing)"

    @cached_property
    def dataset(self) -> xr.Dataset:
        """The record, or what there is of it."""
        return open_result(self.directory)

    @cached_property
    def kpis(self) -> dict[str, float]:
        """KPIs as saved; of an unfinished run, those of the part that is there."""
        try:
            saved: dict[str, float] = json.loads((self.directory / "kpis.json").read_text(encoding="utf-8"))
            kpis = {key: float("nan") if value is None else float(value) for key, value in saved.items()}
        except (OSError, ValueError, TypeError, AttributeError):  # absent, or damaged
            kpis = {}
        if kpis.keys() >= _ALWAYS:
            return kpis
        from bess.analysis.kpis import kpis as compute

        return kpis | compute(self.dataset)

    @cached_property
    def system(self) -> System:
        """The plant that ran."""
        from bess.parameters import System

        return System(self.identity["system"], name=self.name)

    @cached_property
    def solve_time_s(self) -> NDArray[np.float64] | None:
        """Wall-clock time of each step [s], NaN where nothing was solved; None without a log of all steps."""
        try:
            lines = (self.directory / LOG).read_text(encoding="utf-8").splitlines()
            times = np.array([json.loads(line).get("solve_time_s") or np.nan for line in lines], dtype=float)
        except (OSError, ValueError, TypeError, AttributeError):  # absent, or damaged
            return None
        steps = self.dataset.sizes["time"]
        return times[:steps] if len(times) >= steps and np.isfinite(times).any() else None


def runs_in(directory: Path) -> tuple[dict[str, Run], dict[str, str]]:
    """Return the runs of a directory by name, and why others in it cannot be shown.

    Raises
    ------
    InputError
        If there is none to show.
    """
    runs: dict[str, Run] = {}
    problems: dict[str, str] = {}
    folders = scenario_directories(directory)
    for name in sorted(folders, key=_order_in(directory)):
        folder = folders[name]
        run = Run(name, folder, read_identity(folder) or {})
        try:
            _ = run.kpis
        except BessError as error:
            problems[name] = str(error)
        else:
            runs[name] = run
    if not runs:
        reason = next(iter(problems.values()), f"{directory}: holds no run")
        raise InputError(f"{reason}; bess report needs the folder that bess run or bess sweep wrote")
    return runs, problems


def _order_in(directory: Path) -> Callable[[str], tuple[int, str]]:
    """Order of the study file, as the summary of all runs has it; names it does not have come last."""
    try:
        summary = list(json.loads((directory / "kpis.json").read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        summary = []
    places = {name: index for index, name in enumerate(summary)}
    return lambda name: (places.get(name, len(places)), name)
