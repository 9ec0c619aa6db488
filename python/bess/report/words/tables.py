"""Tables of the report: KPIs of scenarios side by side, the best marked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from bess.simulation.analysis.catalogue import Kpi, KpisByRun, grouped, kpi

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
"""What one looks at first when choosing among runs."""


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


@dataclass(frozen=True)
class Group:
    """KPIs under one heading."""

    heading: str
    rows: tuple[Row, ...]


def decision_table(kpis: KpisByRun, *, alike: bool = True) -> list[Row]:
    """The KPIs compared first, as far as any run has them; of runs that are alike, the best are marked."""
    return [
        _row(kpi(name), _values(kpis, name), alike=alike)
        for name in DECISION
        if any(name in row for row in kpis.values())
    ]


def kpi_groups(kpis: KpisByRun, *, alike: bool = True) -> list[Group]:
    """All KPIs under the headings of the catalogue; of several runs that are alike, the best are marked."""
    return [
        Group(heading, tuple(_row(kpi(name), _values(kpis, name), alike=alike) for name in names))
        for heading, names in grouped(key for values in kpis.values() for key in values).items()
    ]


def _values(kpis: KpisByRun, name: str) -> list[float]:
    return [values.get(name, math.nan) for values in kpis.values()]


def _row(entry: Kpi, values: list[float], *, alike: bool) -> Row:
    texts = [entry.number(value) for value in values]
    known = [value for value in values if not math.isnan(value)]
    differ = len({entry.number(value) for value in known}) > 1
    judged = alike and entry.better is not None and entry.decimals is not None and differ
    best = (max if entry.better == "max" else min)(known, default=math.nan)
    cells = []
    for text, value in zip(texts, values, strict=True):
        first = judged and text == entry.number(best)
        behind = judged and not first and not math.isnan(value)
        cells.append(Cell(text, first, _signed(entry, value - best) if behind else ""))
    return Row(entry.heading, entry.meaning, entry.detail, tuple(cells))


def _signed(entry: Kpi, difference: float) -> str:
    return ("+" if difference > 0.0 else "-") + entry.number(abs(difference))
