"""Charts as data: panels of series over one shared axis; and their drawing as matplotlib figures.

Long series are already reduced, once for print and page (``bess.report.data``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from bess.report.drawing.style import (
    BACKGROUND,
    BACKGROUND_ALPHA,
    EVENT,
    EVENT_ALPHA,
    INK,
    SOFT_INK,
    new_figure,
    styled,
)

Values = NDArray[Any]


@dataclass(frozen=True)
class Series:
    """One line, step line, set of dots, or band."""

    x: Values
    y: Values
    """``(n,)``: for ``step`` and ``band``, ``y[i]`` holds on ``[x[i], x[i + 1])``."""
    colour: str
    """Hexadecimal."""
    label: str = ""
    """In the legend; series of one chart with equal labels share one entry. Empty: no entry."""
    kind: Literal["line", "step", "dots", "star", "band"] = "line"
    """Type of drawing."""
    base: Values | float = 0.0
    """``(n,)``: lower edge of a ``band``; ``y`` is the upper one."""
    dashed: bool = False
    """Whether a line is broken."""
    names: tuple[str, ...] = ()
    """Names of the points, shown as tooltips."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes, and a band on a separate axis behind it."""

    y_label: str
    series: Sequence[Series]
    background: Series | None = None
    background_label: str = ""
    log: bool = False
    y_limits: tuple[float, float] | None = None
    title: str = ""
    annotations: Sequence[tuple[float, float, str]] = ()


@dataclass(frozen=True)
class Span:
    """A marked interval of the horizontal axis, such as an event."""

    start: Any
    end: Any
    label: str


@dataclass(frozen=True)
class Chart:
    """Panels one above the other (or in ``columns``) over one horizontal axis."""

    x_label: str
    panels: Sequence[Panel]
    columns: int = 1
    panel_height_in: float = 1.55
    width_in: float = 7.2
    spans: Sequence[Span] = ()


def spans_label(chart: Chart) -> str:
    """Labels of the marked intervals, in one line."""
    return "event: " + "; ".join(dict.fromkeys(span.label for span in chart.spans))


def background_reach(background: Series) -> float:
    """Upper end of the axis of a background; the lower end is its negative."""
    return 1.15 * (float(np.nanmax(np.abs(background.y), initial=0.0)) or 1.0)


_MAX_LEGEND_ENTRIES = 8
_MAX_VECTOR_DOTS = 100


@styled()
def draw(chart: Chart) -> Figure:
    """Draw a chart. The legend stands above the panels, never over data; many strings get a colour scale."""
    rows = -(-len(chart.panels) // chart.columns)
    figure = new_figure(chart.width_in, rows * chart.panel_height_in + 0.55)
    axes = figure.subplots(rows, chart.columns, sharex=True, squeeze=False)
    for index, panel in enumerate(chart.panels):
        place = axes[index // chart.columns, index % chart.columns]
        _panel(place, panel)
        label = spans_label(chart) if panel is chart.panels[-1] else None  # the last entry of the legend
        for span in chart.spans:
            place.axvspan(
                span.start, span.end, color=EVENT, alpha=EVENT_ALPHA, linewidth=0, zorder=0, label=label
            )
    for unused in axes.ravel()[len(chart.panels) :]:
        unused.remove()
    for column in range(chart.columns):
        lowest = axes[(len(chart.panels) - 1 - column) // chart.columns, column]
        lowest.set_xlabel(chart.x_label)
        lowest.tick_params(labelbottom=True)  # also above an unused place
    figure.align_ylabels()
    _legend(figure, axes, chart)
    return figure


def _panel(axes: Axes, panel: Panel) -> None:
    if panel.background is not None:
        behind = axes.twinx()
        behind.grid(visible=False)
        behind.spines["right"].set_visible(True)
        behind.spines["right"].set_color(BACKGROUND)
        behind.tick_params(axis="y", colors=SOFT_INK)
        behind.set_ylabel(panel.background_label, color=SOFT_INK)
        _series(behind, panel.background, alpha=BACKGROUND_ALPHA)
        reach = background_reach(panel.background)
        behind.set_ylim(-reach, reach)
        axes.set_zorder(behind.get_zorder() + 1)
        axes.patch.set_visible(False)
    for series in panel.series:
        _series(axes, series)
    for x, y, text in panel.annotations:
        axes.annotate(text, (x, y), xytext=(5, 5), textcoords="offset points", fontsize=6.5, color=INK)
    if panel.log:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    if panel.y_limits is not None:
        axes.set_ylim(*panel.y_limits)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title, loc="left")
    axes.margins(x=0.01)


def _series(axes: Axes, series: Series, **shown: Any) -> None:
    x, y = series.x, series.y
    shown |= {"color": series.colour, "label": series.label or None}
    dash: dict[str, Any] = {"linestyle": (0, (4, 2)) if series.dashed else "-"}
    many = len(x) > _MAX_VECTOR_DOTS
    match series.kind:
        case "line":
            axes.plot(x, y, **dash, **shown)
        case "step":
            turns = _turns(y)
            axes.plot(x[turns], y[turns], drawstyle="steps-post", **dash, **shown)
        case "dots":
            axes.plot(x, y, ".", color=series.colour, markersize=3 if many else 6, rasterized=many)
            axes.plot([], [], ".", **shown)  # the legend needs no small dots
        case "star":
            axes.plot(x, y, "*", markersize=13, zorder=5, **shown)
        case "band":
            base = np.broadcast_to(series.base, y.shape)
            turns = _turns(y, base)
            axes.fill_between(x[turns], base[turns], y[turns], step="post", linewidth=0, **shown)


def _turns(*edges: Values) -> Values:
    """Ends of a step line and the steps at which its value changes: no other points are needed."""
    turns = np.ones(len(edges[0]), dtype=bool)
    turns[1:-1] = np.any([np.diff(edge)[:-1] != 0.0 for edge in edges], axis=0)
    return turns


def _legend(figure: Figure, axes: Any, chart: Chart) -> None:
    entries: dict[str, Any] = {}
    for place in figure.axes:
        for handle, label in zip(*place.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    strings = {label: handle for label, handle in entries.items() if label.startswith("string ")}
    if len(strings) > _MAX_LEGEND_ENTRIES:
        scale = ScalarMappable(
            BoundaryNorm(np.arange(len(strings) + 1) - 0.5, len(strings)),
            ListedColormap([handle.get_color() for handle in strings.values()]),
        )
        ticks = np.arange(0, len(strings), -(-len(strings) // 10))
        bar = figure.colorbar(scale, ax=axes, location="top", aspect=60, pad=0.01, fraction=0.02, ticks=ticks)
        bar.set_label("string")
        bar.ax.minorticks_off()
        entries = {label: handle for label, handle in entries.items() if label not in strings}
    if len(entries) > 1 or (entries and not strings):
        wide, widths = 18 * chart.width_in, [len(label) + 9 for label in entries]  # in characters
        fits = (n for n in range(len(entries), 0, -1) if sum(map(max, np.array_split(widths, n))) <= wide)
        columns = next(fits, 1)
        figure.legend(entries.values(), entries, loc="outside upper center", ncols=columns)
