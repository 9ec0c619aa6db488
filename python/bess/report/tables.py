"""Tables of the report: KPIs of scenarios side by side, the best marked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bess.analysis.catalogue import Kpi, in_order, kpi


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
    cells: tuple[Cell, ...]


def kpi_rows(kpis: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """KPIs in the order of the catalogue; with several scenarios, the best of what has a better direction."""
    return _rows(kpis, detail=False)


def other_rows(kpis: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """Details that the first table leaves out."""
    return _rows(kpis, detail=True)


def _rows(kpis: Mapping[str, Mapping[str, float]], *, detail: bool) -> list[Row]:
    names = in_order(key for values in kpis.values() for key in values)
    return [
        _row(entry, [values.get(name, math.nan) for values in kpis.values()])
        for name in names
        if (entry := kpi(name)).detail is detail
    ]


def _row(entry: Kpi, values: list[float]) -> Row:
    texts = [entry.number(value) for value in values]
    judged = entry.better is not None and entry.decimals is not None and len(set(texts)) > 1
    known = [value for value in values if not math.isnan(value)]
    best = (max if entry.better == "max" else min)(known, default=math.nan)
    cells = []
    for text, value in zip(texts, values, strict=True):
        first = judged and text == entry.number(best)
        behind = judged and not first and not math.isnan(value)
        cells.append(Cell(text, first, _signed(entry, value - best) if behind else ""))
    return Row(entry.heading, entry.meaning, tuple(cells))


def _signed(entry: Kpi, difference: float) -> str:
    return ("+" if difference > 0.0 else "-") + entry.number(abs(difference))
