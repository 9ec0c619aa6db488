"""Tables of the report: KPIs of scenarios side by side with the best marked, and the table of a sweep."""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Final

import numpy as np

from bess.errors import InputError
from bess.report.charts import kpi_figures
from bess.report.charts.kpi_figures import RADAR_KPIS, changing_kpis, front_of
from bess.report.contents import FigureSpec
from bess.simulation.analysis.catalogue import KpisByRun, better, grouped, kpi, serving_most
from bess.simulation.sweep import RESERVED, SWEEP_CSV, is_parameter

DECISION: Final = (
    "fulfilment_pct",
    "undelivered_kwh",
    "inverter_loss_kwh",
    "battery_loss_kwh",
    "lost_kwh",
    "net_eur",
    "system_efficiency_pct",
    "peak_string_temperature_c",
)
"""Main KPIs for a choice among runs."""


@dataclass(frozen=True)
class Cell:
    """A number as shown, whether it is the best of its row, and how far it is from the best."""

    text: str
    best: bool = False
    behind: str = ""


@dataclass(frozen=True)
class Row:
    """One KPI for every scenario."""

    label: str
    meaning: str
    detail: bool
    cells: tuple[Cell, ...]


def decision_table(kpis: KpisByRun, *, alike: bool = True) -> list[Row]:
    """Main KPIs, as far as any run has them; the best values of comparable runs are marked."""
    return _rows(kpis, [name for name in DECISION if any(name in row for row in kpis.values())], alike)


def kpi_groups(kpis: KpisByRun, *, alike: bool = True) -> dict[str, list[Row]]:
    """All KPIs under the headings of the catalogue; the best values of comparable runs are marked."""
    headings = grouped(key for values in kpis.values() for key in values)
    return {heading: _rows(kpis, names, alike) for heading, names in headings.items()}


def _rows(kpis: KpisByRun, names: Iterable[str], alike: bool) -> list[Row]:
    rows = []
    for entry, values in ((kpi(name), [row.get(name, math.nan) for row in kpis.values()]) for name in names):
        known = [value for value in values if not math.isnan(value)]
        differ = len({entry.number(value) for value in known}) > 1
        judged = alike and entry.better is not None and entry.decimals is not None and differ
        best = (max if entry.better == "max" else min)(known, default=math.nan)
        cells = []
        for value in values:
            first = judged and entry.number(value) == entry.number(best)
            behind = ""
            if judged and not first and not math.isnan(value):
                behind = ("+" if value > best else "-") + entry.number(abs(value - best))
            cells.append(Cell(entry.number(value), first, behind))
        rows.append(Row(entry.heading, entry.meaning, entry.detail, tuple(cells)))
    return rows


_X, _Y = "battery_efficiency_pct", "inverter_efficiency_pct"
_MIN_POINTS = 3
_DEPRECIATION = "cycle_wear_eur_mwh"
_OF_A_LIFE = ("discharged_kwh", "end_of_life_days", _DEPRECIATION, "investment_eur")
"""KPIs shown in addition to that of a search."""
_ATTENTION = {
    "net_eur": "largest net income",
    "lost_kwh": "least lost",
    "peak_string_temperature_c": "coolest",
}


@dataclass(frozen=True)
class SweepTable:
    """Finished scenarios of a sweep, in its order, and the failed ones with their errors."""

    parameters: dict[str, dict[str, str]]
    kpis: dict[str, dict[str, float]]
    failed: dict[str, str]
    maximised: str | None = None

    @property
    def has_front(self) -> bool:
        """Whether a number was swept: a handful of named scenarios is compared, but forms no front."""
        return len(self._compared) >= _MIN_POINTS and bool(self._swept)

    def exhibits(self) -> Iterator[FigureSpec]:
        """Front of inverter and battery efficiency, and KPIs over the parameter if one number was swept."""
        if not self.has_front:
            return
        yield FigureSpec(
            "front",
            "Pareto front",
            "Inverter against battery efficiency of all scenarios; the knee is the point farthest from the "
            "chord between the ends of the front.",
            partial(kpi_figures.pareto_front, self._compared, x=_X, y=_Y),
        )
        for key, values in self._swept.items():
            if self.maximised is not None and (found := self._found(key, self.maximised)):
                kpis = {run: self.kpis[run] for run in found}
                shown = [
                    name
                    for name in (self.maximised, *_OF_A_LIFE)
                    if all(math.isfinite(row.get(name, math.nan)) for row in kpis.values())
                ]
                yield FigureSpec(
                    "search",
                    f"{kpi(self.maximised).label} over {key}",
                    "One point for each run; later runs lie around the best value.",
                    partial(kpi_figures.kpi_lines, kpis, list(found.values()), key, shown),
                )
            if len(set(values)) == len(values) and changing_kpis(self.kpis):
                yield FigureSpec(
                    "kpis-over-parameter",
                    f"KPIs over {key}",
                    "One point for each scenario.",
                    partial(kpi_figures.kpi_lines, self.kpis, values, key),
                )
                return

    def front_sentence(self) -> str:
        """How many scenarios are on the front, and which of them is its knee."""
        if not self.has_front:
            return ""
        if self.maximised is not None:
            return self._search_sentence(self.maximised)
        points, on_front, knee = front_of(self._compared, _X, _Y)
        names, number = np.array(list(self._compared)), int(on_front.sum())
        if knee is None:
            _, first = np.unique(points[on_front], axis=0, return_index=True)
            said = "; ".join(map(self._said, names[on_front][first]))
            text = (
                "The front of inverter and battery efficiency has no knee, because it has only "
                f"{first.size} of {on_front.size} points: {said}."
            )
        else:
            row = self._compared[names[knee]]
            text = (
                f"Knee of the front: {self._said(names[knee])}, with {kpi(_Y).quantity(row[_Y])} inverter "
                f"and {kpi(_X).quantity(row[_X])} battery efficiency. {number} "
                f"of {on_front.size} scenarios lie on the front of these two."
            )
        left_out = len(self.kpis) - on_front.size
        return f"{text} Not compared, because more demand is unmet: {left_out}." if left_out else text

    def _search_sentence(self, name: str) -> str:
        """Best parameter value of a search, and what is lost at both ends of its range."""
        key = next(iter(self._swept))
        at = self._found(key, name)
        if not at:
            return ""
        values, found = np.array(sorted((value, self.kpis[run][name]) for run, value in at.items())).T
        place = int(np.argmax(found))
        best = next(run for run in at if self.kpis[run][name] == found[place])

        def cost(value: float) -> str:
            lost = found[place] - float(np.interp(value, values, found))
            share = f" ({100.0 * lost / abs(found[place]):.1f} %)" if found[place] else ""
            return f"{kpi(name).quantity(lost)}{share}"

        inside = "" if 0 < place < values.size - 1 else ", at an end of the range"
        text = (
            f"Best {key}: {values[place]:g}, with {kpi(name).label.lower()} "
            f"{kpi(name).quantity(found[place])}{inside}. "
            f"{values[0]:g} costs {cost(values[0])}, {values[-1]:g} costs {cost(values[-1])}."
        )
        depreciation = self.kpis[best].get(_DEPRECIATION, math.nan)
        if key == "wear.eur_per_mwh" and math.isfinite(depreciation):
            text += f" The depreciation price, {depreciation:.1f}, costs about {cost(depreciation)}."
        return text

    def picks(self) -> tuple[list[str], list[tuple[str, list[str]]]] | None:
        """Heads of a table, and its rows: the reason to show a point, its parameters and KPIs."""
        if not self.has_front:
            return None
        names = list(self._compared)
        _, _, knee = front_of(self._compared, _X, _Y)
        reasons = {} if knee is None else {names[knee]: ["knee of the front"]}
        for key, reason in _ATTENTION.items():
            values = {name: row.get(key, math.nan) for name, row in self._compared.items()}
            known = {name: value for name, value in values.items() if math.isfinite(value)}
            if len({kpi(key).number(value) for value in known.values()}) > 1:
                first = (max if better(key) == "max" else min)(known, key=lambda name: known[name])
                reasons.setdefault(first, []).append(reason)
        if not reasons:
            return None
        shown = [key for key in DECISION if all(key in self.kpis[name] for name in reasons)]
        heads = [*(_short(key) for key in self.parameters[names[0]]), *(kpi(key).heading for key in shown)]
        rows = [
            (", ".join(why),
             [*map(_number, self.parameters[name].values()),
              *(kpi(key).number(self.kpis[name][key]) for key in shown)])
            for name, why in reasons.items()
        ]  # fmt: skip
        return heads, rows

    def _found(self, key: str, name: str) -> dict[str, float]:
        """Values of a parameter in the runs with a finite value of a KPI."""
        values = zip(self.kpis, self._swept[key], strict=True)
        return {run: value for run, value in values if math.isfinite(self.kpis[run].get(name, math.nan))}

    def _said(self, name: str) -> str:
        """Parameters of a scenario as numbers."""
        return ", ".join(f"{_short(key)} {_number(value)}" for key, value in self.parameters[name].items())

    @cached_property
    def _compared(self) -> KpisByRun:
        return serving_most(self.kpis)

    @cached_property
    def _swept(self) -> dict[str, list[float]]:
        """Parameters that are numbers and vary: their values in all scenarios."""
        swept = {}
        for key in next(iter(self.parameters.values())):
            with suppress(ValueError):
                values = [float(row[key]) for row in self.parameters.values()]
                if len(set(values)) > 1:
                    swept[key] = values
        return swept


def _short(key: str) -> str:
    """Return a key with its section, as ``policy.name``."""
    return ".".join(key.split(".")[-2:])


def _number(text: str) -> str:
    try:
        return f"{float(text):g}"
    except ValueError:
        return text


def read_sweep(directory: Path) -> SweepTable | None:
    """Read the table of a sweep; None if the folder is not one."""
    path = directory / SWEEP_CSV
    if not path.exists():
        return None
    try:
        return _read(path)
    except (OSError, ValueError, LookupError, TypeError, csv.Error) as error:
        raise InputError(
            f"{path}: is damaged ({error}); run the sweep again, which writes it from what is done"
        ) from error


def _maximised(path: Path) -> str | None:
    """KPI that a search maximised, by its study; None for other sweeps."""
    if not path.exists():
        return None
    axes = tomllib.loads(path.read_text(encoding="utf-8")).get("sweep", [])
    name = next((axis["maximise"] for axis in axes if "maximise" in axis), None)
    return None if name is None else str(name)


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
    return SweepTable(parameters, kpis, failed, _maximised(path.with_name("study.toml")))
