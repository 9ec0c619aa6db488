"""Tables of the report: KPIs of scenarios side by side, the best marked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bess.report.kpi_names import KPI_NAMES

_UNITS = {
    "_pct": "%",
    "_c": "°C",
    "_kwh": "kWh",
    "_kw": "kW",
    "_ms": "ms",
    "_s": "s",
    "_k": "K",
    "_eur": "EUR",
}


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
    cells: tuple[Cell, ...]


def kpi_rows(kpis: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """KPIs with a better direction, in the order of the paper; with several scenarios, the best marked."""
    return [
        _judged(key, [entry[key] for entry in kpis.values()])
        for key in KPI_NAMES
        if all(key in entry for entry in kpis.values())
    ]


def other_rows(kpis: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """All other KPIs, as they are."""
    keys = [key for key in next(iter(kpis.values())) if key not in KPI_NAMES]
    return [
        Row(_label(key), tuple(Cell(_number(entry.get(key, math.nan))) for entry in kpis.values()))
        for key in keys
    ]


def _judged(key: str, values: list[float]) -> Row:
    name = KPI_NAMES[key]
    rounded = [round(value, name.decimals) for value in values]
    best = (max if name.better == "max" else min)(rounded)
    judged = len(set(rounded)) > 1
    cells = tuple(
        Cell(
            f"{value:.{name.decimals}f}",
            judged and value == best,
            f"{value - best:+.{name.decimals}f}" if judged and value != best else "",
        )
        for value in rounded
    )
    return Row(name.label, cells)


def _label(key: str) -> str:
    for suffix, unit in _UNITS.items():
        if key.endswith(suffix):
            return f"{_sentence(key.removesuffix(suffix))} ({unit})"
    return _sentence(key)


def _sentence(key: str) -> str:
    text = key.replace("_", " ").replace("soc", "SOC")
    return text[:1].upper() + text[1:]


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    if value == int(value) and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{value:,.2f}" if abs(value) >= 1.0 else f"{value:.3g}"
