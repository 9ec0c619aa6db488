"""KPIs as bars, and as a radar that compares scenarios."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bess.errors import InputError
from bess.report.drawing.style import DOUBLE_COLUMN_IN, INK, SINGLE_COLUMN_IN, colours, new_figure, styled
from bess.simulation.analysis.catalogue import CATALOGUE, KpisByRun

EFFICIENCIES: Final = (
    "availability_pct",
    "derating_efficiency_pct",
    "inverter_efficiency_pct",
    "battery_efficiency_pct",
    "system_efficiency_pct",
)
"""Those of the paper, in its order."""
RADAR_KPIS: Final = (*EFFICIENCIES, "peak_mean_temperature_c")

_INNERMOST = 0.25
_MOST_LABELLED_BARS = 15


@styled
def kpi_bars(kpis: KpisByRun) -> Figure:
    """Efficiencies as bars, the value on each; the axis starts where differences can be seen, and says so.

    Parameters
    ----------
    kpis
        KPIs of each scenario (``bess.kpis``), by name; one scenario may have the empty name.
    """
    check_drawable(kpis, EFFICIENCIES)
    values = np.array([[entry[key] for key in EFFICIENCIES] for entry in kpis.values()])
    count = len(kpis)
    figure = new_figure(SINGLE_COLUMN_IN if count == 1 else DOUBLE_COLUMN_IN, 2.7)
    axes = figure.subplots()
    width = 0.62 if count == 1 else 0.82 / count
    lowest = float(np.nanmin(values))
    floor = min(max(5.0 * np.floor((lowest - 1.0) / 5.0), 0.0), 95.0)
    for index, (row, colour) in enumerate(zip(values, colours(count), strict=True)):
        place = np.arange(len(EFFICIENCIES)) + (index - (count - 1) / 2) * width
        bars = axes.bar(place, row - floor, width * 0.94, bottom=floor, color=colour)
        if values.size <= _MOST_LABELLED_BARS:
            axes.bar_label(bars, [f"{value:.1f}" for value in row], padding=1.5, fontsize=7)
    axes.set_xticks(
        range(len(EFFICIENCIES)), [CATALOGUE[key].label.replace(" ", "\n") for key in EFFICIENCIES]
    )
    axes.set_ylim(floor, 100.0 + 0.1 * (100.0 - floor))
    axes.set_ylabel("KPI (%)" if floor == 0.0 else f"KPI (%), axis starts at {floor:g} %")
    axes.grid(visible=False, axis="x")
    if count > 1:
        handles = [Patch(color=c, label=name) for name, c in zip(kpis, colours(count), strict=True)]
        figure.legend(handles=handles, loc="outside upper center", ncols=min(count, 8))
    return figure


@styled
def kpi_radar(kpis: KpisByRun) -> Figure:
    """Radar of KPIs, one polygon for each scenario, better outwards.

    Every axis runs from the worst to the best value met, which are written at its ends: differences of a
    tenth of a point stay visible, and nobody has to guess their size. An axis on which all are equal is
    drawn full.

    Raises
    ------
    InputError
        There are fewer than two scenarios.
    """
    check_drawable(kpis, RADAR_KPIS)
    if len(kpis) < 2:
        raise InputError("kpi_radar: needs at least two scenarios to compare")
    values = np.array([[entry[key] for key in RADAR_KPIS] for entry in kpis.values()])
    signs = np.array([1.0 if CATALOGUE[key].better == "max" else -1.0 for key in RADAR_KPIS])
    worst = signs * (signs * values).min(axis=0)
    best = signs * (signs * values).max(axis=0)
    span = np.where(best == worst, 1.0, best - worst)
    share = np.where(best == worst, 1.0, (values - worst) / span)
    radius = _INNERMOST + (1.0 - _INNERMOST) * share
    angles = np.linspace(0.0, 2.0 * np.pi, len(RADAR_KPIS), endpoint=False)

    figure = new_figure(4.6, 4.3)
    axes = figure.add_subplot(projection="polar")
    axes.set_theta_offset(np.pi / 2)  # type: ignore[attr-defined]
    axes.set_theta_direction(-1)  # type: ignore[attr-defined]
    closed = np.append(angles, angles[0])
    markers = "osD^vP*"
    for index, (row, name, colour) in enumerate(zip(radius, kpis, colours(len(kpis)), strict=True)):
        outline = np.append(row, row[0])
        axes.plot(
            closed, outline, color=colour, marker=markers[index % 7], markersize=4, label=name, zorder=3
        )
        axes.fill(closed, outline, color=colour, alpha=0.08, linewidth=0)
    axes.set_ylim(0.0, 1.05)
    axes.set_yticks([_INNERMOST, 1.0], ["", ""])
    axes.set_xticks(angles, ["" for _ in angles])
    axes.spines["polar"].set_visible(False)
    for angle, key, low, high in zip(angles, RADAR_KPIS, worst, best, strict=True):
        kpi = CATALOGUE[key]
        side, above = np.sin(angle), np.cos(angle)
        where = "center" if abs(side) < 0.1 else ("left" if side > 0 else "right")
        ends = [kpi.quantity(value) for value in (high, low)]
        text = f"{kpi.label}\nbest {ends[0]}\nworst {ends[1]}"
        axes.annotate(
            text, (angle, 1.05), xytext=(7 * side, 7 * above), textcoords="offset points", ha=where,
            va="bottom" if above > 0.9 else ("top" if above < -0.9 else "center"), fontsize=7, color=INK,
            annotation_clip=False,
        )  # fmt: skip
    figure.legend(loc="outside upper center", ncols=min(len(kpis), 6))
    return figure


def check_drawable(kpis: KpisByRun, needed: Iterable[str]) -> None:
    """Raise InputError unless there are runs, and each has a number for every KPI that is ``needed``."""
    if not kpis:
        raise InputError("no scenario to draw")
    for name, entry in kpis.items():
        for key in needed:
            if not np.isfinite(entry.get(key, np.nan)):
                which = f"scenario {name!r}" if name else "the run"
                raise InputError(f"{which}: KPI {key} is {entry.get(key, 'missing')}; it cannot be drawn")
