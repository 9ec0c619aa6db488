"""Many scenarios: a Pareto front, and KPIs over a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from bess.errors import InputError
from bess.report.charts.kpi_figures import RADAR_KPIS
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import AVAILABILITY, BACKGROUND, DISCHARGE, colours
from bess.simulation.analysis.catalogue import KpisByRun, better, kpi
from bess.simulation.analysis.pareto import knee_point, non_dominated


def pareto_front(
    kpis: KpisByRun,
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
        KPIs of the axes; whether larger is better is taken from
        :data:`bess.simulation.analysis.catalogue.CATALOGUE`.
    """
    names = list(kpis)
    points = np.array([[kpis[name][x], kpis[name][y]] for name in names], dtype=float)
    directions = [better(x), better(y)]
    on_front = non_dominated(points, directions)
    order = np.flatnonzero(on_front)[np.argsort(points[on_front][:, 0])]
    knee = knee_point(points, directions)

    def dots(rows: Sequence[int] | Values, colour: str, label: str, kind: Literal["dots", "star"]) -> Series:
        x, y = points[list(rows)].T
        return Series(x, y, colour, label, kind, names=tuple(names[row] for row in rows))

    series = [
        Series(points[order, 0], points[order, 1], DISCHARGE, "front"),
        dots(order, DISCHARGE, "", "dots"),
        dots([knee], AVAILABILITY, f"knee: {names[knee]}", "star"),
    ]
    if not on_front.all():
        series.insert(0, dots(np.flatnonzero(~on_front), BACKGROUND, "dominated", "dots"))
    ends = {names[order[0]], names[order[-1]]} - {names[knee]}
    notes = tuple((kpis[name][x], kpis[name][y], name) for name in sorted(ends))
    return Chart(
        kpi(x).heading,
        (Panel(kpi(y).heading, tuple(series), annotations=notes),),
        panel_height_in=3.0,
        width_in=4.6,
    )


def changing_kpis(kpis: KpisByRun) -> list[str]:
    """KPIs of the radar that are not the same everywhere, at the digits shown."""
    return [key for key in RADAR_KPIS if len({kpi(key).number(entry[key]) for entry in kpis.values()}) > 1]


def kpi_lines(kpis: KpisByRun, values: Sequence[float], label: str, keys: Sequence[str] = ()) -> Chart:
    """KPIs that change with the value of one parameter: what bars and a radar cannot hold.

    Parameters
    ----------
    kpis
        KPIs of each scenario, by name.
    values
        The parameter in each of them.
    label
        Name of the parameter, for the axis.
    keys
        The KPIs; by default those of the radar that change.

    Raises
    ------
    InputError
        No key figure changes with the parameter.
    """
    order = np.argsort(values)
    x = np.asarray(values, dtype=float)[order]
    panels = []
    changing = list(keys) or changing_kpis(kpis)
    if not changing:
        raise InputError(f"kpi_lines: no key figure changes with {label}")
    for key, colour in zip(changing, colours(len(changing)), strict=True):
        y = np.array([entry[key] for entry in kpis.values()], dtype=float)[order]
        line = (Series(x, y, colour), Series(x, y, colour, kind="dots"))
        panels.append(Panel(kpi(key).unit, line, title=kpi(key).label))
    return Chart(label, tuple(panels), columns=2, panel_height_in=1.3)
