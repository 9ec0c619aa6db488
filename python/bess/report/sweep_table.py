"""The table of a sweep, as far as a report needs it: parameters, KPIs, and the front they form."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bess.analysis.catalogue import better
from bess.analysis.pareto import hypervolume, knee_point, non_dominated
from bess.errors import InputError
from bess.report import charts
from bess.report.charts.kpi_figures import RADAR_KPIS
from bess.report.charts.many import changing_kpis
from bess.report.contents import Exhibit
from bess.sweep.table import RESERVED, SWEEP_CSV, is_parameter

_X, _Y = "battery_efficiency_pct", "inverter_efficiency_pct"
_FEWEST_POINTS = 3


@dataclass(frozen=True)
class SweepTable:
    """Finished scenarios of a sweep, in its order, and the failed ones with their errors."""

    parameters: dict[str, dict[str, str]]
    kpis: dict[str, dict[str, float]]
    failed: dict[str, str]

    @property
    def has_front(self) -> bool:
        """Whether a number was swept: a handful of named scenarios is compared, but forms no front."""
        return len(self.kpis) >= _FEWEST_POINTS and any(True for _ in self._numeric_parameters())

    def exhibits(self) -> Iterator[Exhibit]:
        """Front of inverter and battery efficiency, and KPIs over the parameter if one number was swept."""
        if not self.has_front:
            return
        yield Exhibit(
            "front",
            "Pareto front",
            "Inverter against battery efficiency of all scenarios; the knee is the point farthest from the "
            "chord between the ends of the front.",
            partial(charts.pareto_front, self.kpis, x=_X, y=_Y),
        )
        for key in self._numeric_parameters():
            values = [float(row[key]) for row in self.parameters.values()]
            if len(set(values)) == len(values) and changing_kpis(self.kpis):
                yield Exhibit(
                    "kpis-over-parameter",
                    f"Key figures over {key}",
                    "One point for each scenario.",
                    partial(charts.kpi_lines, self.kpis, values, key),
                )
                return

    def front_sentence(self) -> str:
        """Size of the front, its knee, and its hypervolume."""
        if not self.has_front:
            return ""
        names = list(self.kpis)
        points = np.array([[row[_X], row[_Y]] for row in self.kpis.values()])
        directions = [better(_X), better(_Y)]
        worst, best = points.min(axis=0), points.max(axis=0)
        volume = hypervolume(points, worst, directions)
        box = float(np.prod(best - worst))
        knee = knee_point(points, directions)
        share = f", {100.0 * volume / box:.1f} % of the box between worst and best" if box > 0.0 else ""
        return (
            f"{int(non_dominated(points, directions).sum())} of {len(names)} scenarios lie on the front of "
            f"inverter and battery efficiency. Knee: {names[knee]} with {points[knee, 1]:.2f} % inverter and "
            f"{points[knee, 0]:.2f} % battery efficiency. Hypervolume against the worst values met "
            f"({worst[1]:.2f} %, {worst[0]:.2f} %): {volume:.3g} square points{share}."
        )

    def _numeric_parameters(self) -> Iterator[str]:
        for key in next(iter(self.parameters.values())):
            try:
                values = {float(row[key]) for row in self.parameters.values()}
            except ValueError:
                continue
            if len(values) > 1:
                yield key


def read_sweep(directory: Path) -> SweepTable | None:
    """Read the table of a sweep; None if the folder is not one.

    Raises
    ------
    InputError
        The table is damaged.
    """
    path = directory / SWEEP_CSV
    if not path.exists():
        return None
    try:
        return _read(path)
    except (OSError, ValueError, LookupError, TypeError, csv.Error) as error:
        raise InputError(
            f"{path}: is damaged ({error}); run the sweep again, which writes it from what is done"
        ) from error


def _read(path: Path) -> SweepTable:
    parameters: dict[str, dict[str, str]] = {}
    kpis: dict[str, dict[str, float]] = {}
    failed: dict[str, str] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            name = row["name"]
            if row["status"] != "done":
                failed[name] = row["error"] or "not finished; run the sweep again to continue"
                continue
            values = {
                key: float(value) if value else math.nan
                for key, value in row.items()
                if key not in RESERVED and not is_parameter(key)
            }
            if not all(math.isfinite(values.get(key, math.nan)) for key in RADAR_KPIS):
                failed[name] = "its KPIs are incomplete"
                continue
            kpis[name] = values
            parameters[name] = {key: value for key, value in row.items() if is_parameter(key)}
    return SweepTable(parameters, kpis, failed)
