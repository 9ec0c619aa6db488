"""KPIs of runs: bars, radar, loss breakdown, Pareto front, and curves over a parameter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, Literal

import numpy as np
from matplotlib.figure import Figure

from bess.errors import InputError
from bess.report.data import Result, dataset_of
from bess.report.drawing import style
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import colours, new_figure, styled
from bess.simulation.analysis import energy_flow as analysis
from bess.simulation.analysis.catalogue import CATALOGUE, KpisByRun, better, kpi
from bess.simulation.analysis.pareto import knee_point, non_dominated

EFFICIENCIES: Final = (
    "availability_pct",
    "derating_efficiency_pct",
    "inverter_efficiency_pct",
    "battery_efficiency_pct",
    "system_efficiency_pct",
)
"""Efficiencies of the paper, in its order."""
RADAR_KPIS: Final = (*EFFICIENCIES, "peak_mean_temperature_c")

_INNERMOST = 0.25
_MAX_LABELLED_BARS = 15


@styled()
def kpi_bars(kpis: KpisByRun) -> Figure:
    """Efficiencies as bars with their values; the axis is truncated to show differences, with a note.

    Parameters
    ----------
    kpis
        KPIs of each scenario (``bess.kpis``), by name; one scenario may have the empty name.
    """
    _check_drawable(kpis, EFFICIENCIES)
    values = np.array([[entry[key] for key in EFFICIENCIES] for entry in kpis.values()])
    count = len(kpis)
    figure = new_figure(style.SINGLE_COLUMN_IN if count == 1 else style.DOUBLE_COLUMN_IN, 2.7)
    axes = figure.subplots()
    width = 0.62 if count == 1 else 0.82 / count
    lowest = float(np.nanmin(values))
    floor = min(max(5.0 * np.floor((lowest - 1.0) / 5.0), 0.0), 95.0)
    for index, (name, row, colour) in enumerate(zip(kpis, values, colours(count), strict=True)):
        place = np.arange(len(EFFICIENCIES)) + (index - (count - 1) / 2) * width
        bars = axes.bar(place, row - floor, width * 0.94, bottom=floor, color=colour, label=name)
        if values.size <= _MAX_LABELLED_BARS:
            axes.bar_label(bars, [f"{value:.1f}" for value in row], padding=1.5, fontsize=7)
    axes.set_xticks(
        range(len(EFFICIENCIES)), [CATALOGUE[key].label.replace(" ", "\n") for key in EFFICIENCIES]
    )
    axes.set_ylim(floor, 100.0 + 0.1 * (100.0 - floor))
    axes.set_ylabel("KPI (%)" if floor == 0.0 else f"KPI (%), axis starts at {floor:g} %")
    axes.grid(visible=False, axis="x")
    if count > 1:
        figure.legend(loc="outside upper center", ncols=min(count, 8))
    return figure


@styled()
def kpi_radar(kpis: KpisByRun) -> Figure:
    """Radar of KPIs, one polygon for each scenario, better outwards.

    Every axis runs from the worst to the best value, which are written at its ends, so that small differences
    are visible and their size is known. If all values of an axis are equal, they are at its outer end.

    Raises
    ------
    InputError
        There are fewer than two scenarios.
    """
    _check_drawable(kpis, RADAR_KPIS)
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
    axes = figure.add_subplot(projection="polar", theta_offset=np.pi / 2, theta_direction=-1)
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
            va="bottom" if above > 0.9 else ("top" if above < -0.9 else "center"),
            fontsize=7, color=style.INK, annotation_clip=False,
        )  # fmt: skip
    figure.legend(loc="outside upper center", ncols=min(len(kpis), 6))
    return figure


def _check_drawable(kpis: KpisByRun, needed: Iterable[str]) -> None:
    """Raise InputError unless there are runs, and each has a number for every KPI that is ``needed``."""
    if not kpis:
        raise InputError("no scenario to draw")
    for name, entry in kpis.items():
        for key in needed:
            if not np.isfinite(entry.get(key, np.nan)):
                which = f"scenario {name!r}" if name else "the run"
                raise InputError(f"{which}: KPI {key} is {entry.get(key, 'missing')}; it cannot be drawn")


_NOT_IN_EVERY_RUN = ("hysteresis_loss_kwh", "auxiliary_kwh")
_NEGLIGIBLE_KWH = 0.05


@styled()
def energy_flow(result: Result) -> Figure:
    """Energy flow from grid to storage and back, with undelivered energy and losses of each direction.

    One bar for each step, on an axis from zero; zero values have no bar.

    Parameters
    ----------
    result
        Result of :func:`bess.run`, or its dataset.
    """
    rows = _flow_rows(analysis.energy_flow(dataset_of(result)))
    figure = new_figure(4.6, 0.55 + 0.19 * len(rows))
    axes = figure.subplots()
    for place, (_, low, high, colour) in enumerate(rows):
        total = colour in (style.CHARGE, style.DISCHARGE, style.INK)
        axes.barh(place, high - low, 0.86 if total else 0.6, left=low, color=colour)
        axes.annotate(
            f"{'' if total else '− '}{kpi('lost_kwh').number(high - low)}", (high, place), xytext=(3, 0),
            textcoords="offset points", va="center", fontsize=7, fontweight="bold" if total else "normal",
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [row[0] for row in rows])
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.16 * max(row[2] for row in rows) or 1.0)
    axes.set_xlabel("Energy (kWh)")
    axes.locator_params(axis="x", nbins=5)
    axes.xaxis.set_major_formatter(
        "{x:,.10g}"
    )  # a year of a large plant without a power of ten beside the axis
    axes.grid(visible=False, axis="y")
    return figure


_FLOW_PARTS: Final = {
    "unmet": ("Unmet demand", style.BACKGROUND),
    "derating": ("Derating loss", style.DERATING),
    "availability": ("Availability loss ({})", style.AVAILABILITY),
    "standby": ("Standby", style.BACKGROUND),
    "auxiliary": ("Cooling", style.AUXILIARY),
    "inverter": ("Inverters", style.INVERTER),
    "battery": ("Batteries", style.BATTERY),
    "hysteresis": ("Hysteresis", style.HYSTERESIS),
}
_MISSING: Final = ("unmet", "derating", "availability")
_BESIDE: Final = ("standby", "auxiliary")
_LOST: Final = ("inverter", "battery", "hysteresis")


def _flow_rows(flow: Mapping[str, Mapping[str, float]]) -> list[tuple[str, float, float, str]]:
    """Label, both ends and colour of each bar from the top: charging demand, storage, grid export."""
    charge, discharge = {**flow["charge"], **flow["beside"]}, flow["discharge"]
    taken_kwh = charge["grid"] + charge["standby"] + charge["auxiliary"]
    rows = []
    for label, total, colour, of, parts in (
        ("Charging demand", charge["asked"], style.INK, charge, _MISSING),
        ("Grid import", taken_kwh, style.CHARGE, charge, _BESIDE + _LOST),
        ("Stored", charge["store"], style.CHARGE, charge, ()),
        ("From storage", discharge["store"], style.DISCHARGE, discharge, _LOST),
        ("Grid export", discharge["grid"], style.DISCHARGE, discharge, ()),
        ("Discharging demand", discharge["asked"], style.INK, discharge, _MISSING),
    ):
        rows.append((label, 0.0, total, colour))
        left = total
        for part in parts:
            name, shade = _FLOW_PARTS[part]
            if of[part] > _NEGLIGIBLE_KWH:
                rows.append(
                    (name.format("empty" if of is discharge else "full"), left - of[part], left, shade)
                )
            left -= of[part]
    return rows


@styled()
def losses_compared(kpis: KpisByRun) -> Figure:
    """Unmet and undelivered energy and all losses of each run, stacked; their sum at the end of the bar.

    Parameters
    ----------
    kpis
        KPIs of each run, by name.
    """
    every = {f"{name}_kwh": colour for name, colour in style.LOSSES.items()}
    _check_drawable(kpis, [part for part in every if part not in _NOT_IN_EVERY_RUN])
    parts = {
        part: colour
        for part, colour in every.items()
        if any(entry.get(part, 0.0) > _NEGLIGIBLE_KWH for entry in kpis.values())
    }
    figure = new_figure(5.6, 1.0 + 0.29 * len(kpis))
    axes = figure.subplots()
    places = np.arange(len(kpis))
    ends = np.zeros(len(kpis))
    for part, colour in parts.items():
        values = np.array([entry.get(part, 0.0) for entry in kpis.values()])
        axes.barh(places, values, 0.7, left=ends, color=colour, label=kpi(part).label)
        ends += values
    for place, end in zip(places, ends, strict=True):
        axes.annotate(
            kpi("lost_kwh").number(end), (end, place), xytext=(3, 0), textcoords="offset points",
            va="center", fontsize=7.5,
        )  # fmt: skip
    axes.set_yticks(places, list(kpis))
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.13 * max(float(ends.max()), _NEGLIGIBLE_KWH))
    axes.set_xlabel("Unmet, undelivered and lost (kWh)")
    axes.grid(visible=False, axis="y")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


_MIN_FRONT: Final = 3
"""Minimum number of different points of a front that has a knee."""


def front_of(kpis: KpisByRun, x: str, y: str) -> tuple[Values, Values, int | None]:
    """Scenarios as points ``(n, 2)`` of two KPIs, whether each is on the front, and the index of its knee.

    A front of fewer than three different points has no knee.
    """
    points = np.array([[values[x], values[y]] for values in kpis.values()], dtype=float)
    directions = [better(x), better(y)]
    on_front = non_dominated(points, directions)
    different = len(np.unique(points[on_front], axis=0))
    knee = knee_point(points, directions) if different >= _MIN_FRONT else None
    return points, on_front, knee


def pareto_front(
    kpis: KpisByRun,
    *,
    x: str = "battery_efficiency_pct",
    y: str = "inverter_efficiency_pct",
) -> Chart:
    """Scenarios in the plane of two KPIs: the front as a line, its knee, and the dominated scenarios.

    Parameters
    ----------
    kpis
        KPIs of each scenario, by name.
    x, y
        KPIs of the axes; whether larger is better is taken from
        :data:`bess.simulation.analysis.catalogue.CATALOGUE`.
    """
    names = list(kpis)
    points, on_front, knee = front_of(kpis, x, y)
    order = np.flatnonzero(on_front)[np.argsort(points[on_front][:, 0])]

    def dots(rows: Sequence[int] | Values, colour: str, label: str, kind: Literal["dots", "star"]) -> Series:
        x, y = points[list(rows)].T
        return Series(x, y, colour, label, kind, names=tuple(names[row] for row in rows))

    series = [
        Series(points[order, 0], points[order, 1], style.DISCHARGE, "front"),
        dots(order, style.DISCHARGE, "front", "dots"),
    ]
    ends = {names[order[0]], names[order[-1]]}
    if knee is not None:
        series.append(dots([knee], style.AVAILABILITY, f"knee: {names[knee]}", "star"))
        ends.discard(names[knee])
    if not on_front.all():
        series.insert(0, dots(np.flatnonzero(~on_front), style.BACKGROUND, "dominated", "dots"))
    notes = [(kpis[name][x], kpis[name][y], name) for name in sorted(ends)]
    return Chart(
        kpi(x).heading,
        [Panel(kpi(y).heading, series, annotations=notes)],
        panel_height_in=3.0,
        width_in=4.6,
    )


def changing_kpis(kpis: KpisByRun) -> list[str]:
    """KPIs of the radar that differ between runs at the digits shown."""
    return [key for key in RADAR_KPIS if len({kpi(key).number(entry[key]) for entry in kpis.values()}) > 1]


def kpi_lines(kpis: KpisByRun, values: Sequence[float], label: str, keys: Sequence[str] = ()) -> Chart:
    """KPIs over the values of one parameter, for sweeps with too many scenarios for bars or a radar.

    Parameters
    ----------
    kpis
        KPIs of each scenario, by name.
    values
        Value of the parameter in each scenario.
    label
        Name of the parameter, for the axis.
    keys
        The KPIs; by default those of the radar that change.

    Raises
    ------
    InputError
        No KPI changes with the parameter.
    """
    order = np.argsort(values)
    x = np.asarray(values, dtype=float)[order]
    panels = []
    changing = list(keys) or changing_kpis(kpis)
    if not changing:
        raise InputError(f"kpi_lines: no KPI changes with {label}")
    for key, colour in zip(changing, colours(len(changing)), strict=True):
        y = np.array([entry[key] for entry in kpis.values()], dtype=float)[order]
        line = [Series(x, y, colour), Series(x, y, colour, kind="dots")]
        panels.append(Panel(kpi(key).unit, line, title=kpi(key).label))
    return Chart(label, panels, columns=2, panel_height_in=1.3)
