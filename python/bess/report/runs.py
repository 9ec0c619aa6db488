"""Runs of a directory for a report: KPIs, logs and completeness."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bess.errors import BessError, InputError
from bess.files import parse_json
from bess.simulation.analysis.kpis import kpis
from bess.simulation.record.files import check_file, write_checked
from bess.simulation.record.provenance import read_identity
from bess.simulation.record.result import RESULTS, open_result, scenario_directories
from bess.simulation.record.store import solve_times_s
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr

    from bess.simulation.hindsight.replay import Replay

GAIN_RULE = "gain_rule"
_KPIS = "kpis.json"


@dataclass(frozen=True)
class Run:
    """One run on disk; the record is read when it is first used."""

    name: str
    directory: Path
    identity: dict[str, Any]
    """Version, study as resolved, system document, hashes of data files."""

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
        path = self.directory / "study.toml"
        try:
            check_file(path)
            return path.read_text(encoding="utf-8")
        except (OSError, ValueError):
            return "(the file is missing or damaged)"

    @cached_property
    def dataset(self) -> xr.Dataset:
        """The record, or its saved part."""
        return open_result(self.directory)

    @cached_property
    def kpis(self) -> dict[str, float]:
        """Saved KPIs; for an unfinished run, KPIs of its saved part."""
        saved = {key: value for key, value in self._saved.items() if key != GAIN_RULE}
        try:
            numbers = {key: math.nan if value is None else float(value) for key, value in saved.items()}
        except (ValueError, TypeError):  # damaged
            numbers = {}
        return numbers or kpis(self.dataset)

    @cached_property
    def _saved(self) -> dict[str, Any]:
        return _saved_kpis(self.directory)

    @property
    def policy(self) -> str:
        """Name of the policy that ran."""
        return str(self.study.get("policy", {}).get("name", ""))

    @property
    def gain_rule(self) -> str:
        """The best rule on the demand of this run; empty if no rules were simulated."""
        return str(self._saved.get(GAIN_RULE, ""))

    def run_rules(self) -> None:
        """Simulate the rules on the demand of a finished run, unless done already; save the gain in KPIs."""
        if self.gain_rule or not self.finished:
            return
        from bess.simulation.hindsight.replay import gain_over_rules

        gain = gain_over_rules(self.replay, self.policy)
        self.kpis.update({key: value for key, value in gain.items() if isinstance(value, float)})
        self._saved.update(gain)
        write_checked(self.directory / _KPIS, json.dumps(self._saved, indent=1).encode())

    @cached_property
    def replay(self) -> Replay:
        """Replay of the record under other policies; the rules are simulated once."""
        from bess.simulation.hindsight.replay import Replay

        return Replay.of(self.dataset.load(), self.system)

    @cached_property
    def system(self) -> System:
        """The plant that ran."""
        return System(self.identity["system"], name=self.name)

    @cached_property
    def solve_time_s(self) -> NDArray[np.float64] | None:
        """Wall-clock time of each step [s], NaN where nothing was solved; None without any."""
        try:
            times = solve_times_s(self.directory)
        except InputError:  # damaged
            return None
        each = [times.get(step, np.nan) for step in range(self.dataset.sizes["time"])]
        return np.array(each) if np.isfinite(each).any() else None


def runs_in(directory: Path) -> tuple[dict[str, Run], dict[str, str]]:
    """Return the runs of a directory by name, and the reasons why others cannot be shown."""
    runs: dict[str, Run] = {}
    problems: dict[str, str] = {}
    # In the order of the study file, as in the summary of all runs; names not in it come last.
    places = {name: index for index, name in enumerate(_saved_kpis(directory))}
    folders = scenario_directories(directory).items()
    for name, folder in sorted(folders, key=lambda item: (places.get(item[0], len(places)), item[0])):
        run = Run(name, folder, read_identity(folder) or {})
        try:
            _ = run.kpis
        except BessError as error:
            problems[name] = str(error)
        else:
            runs[name] = run
    if not runs:
        reason = next(iter(problems.values()), f"{directory}: holds no run")
        raise InputError(f"{reason}; give a folder that bess run or bess sweep wrote")
    return runs, problems


def _saved_kpis(directory: Path) -> dict[str, Any]:
    """KPIs in a folder; empty if they are absent or damaged."""
    path = directory / _KPIS
    try:
        check_file(path)
        return dict(parse_json(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}
