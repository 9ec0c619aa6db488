"""Many scenarios: a Pareto front, and KPIs over a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bess.analysis.pareto import knee_point, non_dominated
from bess.report.chart import Chart, Panel, Series
from bess.report.kpi_names import KPI_NAMES, RADAR_KPIS
from bess.report.style import AVAILABILITY, BACKGROUND, DISCHARGE, colours


def pareto_front(
    kpis: Mapping[str, Mapping[str, float]],
    *,
    x: str = "battery_efficiency_pct",
    y: str = "inverter_efficiency_pct",
) -> Chart:
    """Scenarios in the plane of two KPIs: the front as a line, its knee, and what is dominated.

    Parameters
    ----------
    kpis
        KPIs of each scenario, by name.
    x, y
        KPIs of the axes; whether larger is better is taken from :data:`bess.report.kpi_names.KPI_NAMES`.
    """
    names = list(kpis)
    points = np.array([[kpis[name][x], kpis[name][y]] for name in names], dtype=float)
    directions = [KPI_NAMES[x].better, KPI_NAMES[y].better]
    on_front = non_dominated(points, directions)
    front = points[on_front][np.argsort(points[on_front][:, 0])]
    knee = knee_point(points, directions)
    series = [
        Series(front[:, 0], front[:, 1], DISCHARGE, "front"),
        Series(front[:, 0], front[:, 1], DISCHARGE, "", "dots"),
        Series(points[[knee], 0], points[[knee], 1], AVAILABILITY, f"knee: {names[knee]}", "star"),
    ]
    if not on_front.all():
        rest = points[~on_front]
        series.insert(0, Series(rest[:, 0], rest[:, 1], BACKGROUND, "dominated", "dots"))
    ends = {names[int(np.argmin(points[:, 0]))], names[int(np.argmax(points[:, 0]))]} - {names[knee]}
    notes = tuple((kpis[name][x], kpis[name][y], name) for name in sorted(ends))
    return Chart(
        KPI_NAMES[x].label,
        (Panel(KPI_NAMES[y].label, tuple(series), annotations=notes),),
        panel_height_in=3.0,
        width_in=4.6,
    )


def kpi_lines(kpis: Mapping[str, Mapping[str, float]], values: Sequence[float], label: str) -> Chart:
    """KPIs over the value of one parameter: what bars and a radar cannot hold.

    Parameters
    ----------
    kpis
        KPIs of each scenario, by name.
    values
        The parameter in each of them.
    label
        Name of the parameter, for the axis.
    """
    order = np.argsort(values)
    x = np.asarray(values, dtype=float)[order]
    panels = []
    for key, colour in zip(RADAR_KPIS, colours(len(RADAR_KPIS)), strict=True):
        y = np.array([entry[key] for entry in kpis.values()], dtype=float)[order]
        line = (Series(x, y, colour), Series(x, y, colour, kind="dots"))
        panels.append(Panel(KPI_NAMES[key].label, line))
    return Chart(label, tuple(panels), columns=2, panel_height_in=1.3)
