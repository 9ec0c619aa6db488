"""Charts as documents for BokehJS, which the page contains: no network is needed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import (
    BoxAnnotation,
    BoxZoomTool,
    ColumnDataSource,
    DataRange1d,
    GlyphRenderer,
    HoverTool,
    LinearAxis,
    NoOverlap,
    PanTool,
    Range1d,
    ResetTool,
    WheelZoomTool,
)
from bokeh.plotting import figure

from bess.report.drawing.chart import Chart, Panel, Series, Span, Values, spans_label
from bess.report.drawing.style import BACKGROUND, INK

_ALONE_PX = 300
_PANEL_PX = 190
_SMALL_PANEL_PX = 130
_MAX_TALL_PANELS = 4
_ID = re.compile(r'"p[0-9]{4,}"')


@dataclass(frozen=True)
class LegendEntry:
    """One entry of a legend: a button on the page that hides the series with its label."""

    label: str
    colour: str
    kind: str


def legend(chart: Chart) -> list[LegendEntry]:
    """Every label of a chart once, in the order of drawing; the page shows them, so that none is clipped."""
    entries: dict[str, LegendEntry] = {}
    for panel in chart.panels:
        for series in (*panel.series, *([panel.background] if panel.background else [])):
            if series.label:
                kind = "dashed" if series.dashed else series.kind
                kind = "band" if series is panel.background else kind
                entries.setdefault(series.label, LegendEntry(series.label, series.colour, kind))
    if chart.spans:
        entries["events"] = LegendEntry(spans_label(chart), INK, "event")
    return list(entries.values())


def bokeh_script() -> str:
    """The library, as it comes with the Python package."""
    return (resources.files("bokeh") / "server/static/js/bokeh.min.js").read_text(encoding="utf-8")


def bokeh_document(chart: Chart) -> str:
    """Return the JSON that ``Bokeh.embed.embed_item`` draws; panels stand one above the other, x is shared.

    Panels that are side by side in the printed figure are stacked, too, for narrow screens.
    """
    count = len(chart.panels)
    height = _ALONE_PX if count == 1 else (_PANEL_PX if count <= _MAX_TALL_PANELS else _SMALL_PANEL_PX)
    x_range = DataRange1d(range_padding=0.01)
    plots = [
        plot_of(panel, x_range, height, chart.spans, chart.x_label if index == count - 1 else None)
        for index, panel in enumerate(chart.panels)
    ]
    layout = column(plots, sizing_mode="stretch_width", spacing=2)
    return _renumbered(json.dumps(json_item(layout), allow_nan=False, separators=(",", ":")))


def _renumbered(text: str) -> str:
    """Number ids from 1 in each document, so that the same chart gives the same text."""
    numbers: dict[str, str] = {}
    return _ID.sub(lambda found: numbers.setdefault(found[0], f'"p{len(numbers) + 1}"'), text)


AXIS_PX = 46
"""Height of the horizontal axis, which the last panel has."""
TITLE_PX = 22
_MAX_READ_AT_ONCE = 6
_FEW_DOTS = 100
_BEHIND = "behind"
_GREY = "#6A6A6A"
_FONT_SIZE = "12px"


def plot_of(panel: Panel, x_range: Any, height: int, spans: Sequence[Span], x_label: str | None) -> Any:
    """Return the plot of a panel; only one with ``x_label`` shows the axis that all share."""
    drawn = [series for series in panel.series if len(series.x)]
    dates = bool(drawn) and np.issubdtype(drawn[0].x.dtype, np.datetime64)
    zoom = BoxZoomTool(dimensions="width")
    plot = figure(
        height=height + (AXIS_PX if x_label else 0) + (TITLE_PX if panel.title else 0),
        sizing_mode="stretch_width",
        x_axis_type="datetime" if dates else "linear",
        y_axis_type="log" if panel.log else "linear",
        x_range=x_range,
        tools=[PanTool(dimensions="width"), zoom, WheelZoomTool(dimensions="width"), ResetTool()],
        active_drag=zoom,
        toolbar_location="right",
        min_border_left=62,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    _dress(plot, panel)
    plot.xaxis.axis_label = x_label
    plot.xaxis.visible = x_label is not None
    for span in spans:
        left, right = (float(_numbers(np.array([edge]))[0]) for edge in (span.start, span.end))
        plot.add_layout(BoxAnnotation(left=left, right=right, fill_color=INK, fill_alpha=0.07))
    columns = _Columns()
    if panel.background is not None:
        _draw_behind(plot, panel.background, panel.background_label, columns)
    glyphs = list(_glyphs(plot, drawn, columns, panel.y_label))
    if panel.y_limits is not None:
        plot.y_range = Range1d(*panel.y_limits)
    else:
        plot.y_range.renderers = glyphs  # the background has its own axis
    # A band would show its edge only.
    read = [glyph for glyph, series in zip(glyphs, drawn, strict=True) if series.kind != "band"]
    if read:
        plot.add_tools(_reader(read, panel, dates=dates))
    return plot


class _Columns:
    """Sources of data: series over the same instants share one, and equal columns are kept once."""

    def __init__(self) -> None:
        self._sources: dict[bytes, ColumnDataSource] = {}
        self._names: dict[tuple[bytes, bytes], str] = {}

    def source(self, x: Values) -> ColumnDataSource:
        numbers = _numbers(x)
        return self._sources.setdefault(numbers.tobytes(), ColumnDataSource({"x": numbers}))

    def add(self, x: Values, values: Values, name: str) -> str:
        """Put values beside ``x``, in single precision: finer than any screen. Return their column."""
        source, single = self.source(x), values.astype(np.float32)
        key = (_numbers(x).tobytes(), single.tobytes())
        if key not in self._names or self._names[key] != name:
            free = name if name not in source.data else f"{name} {len(source.data)}"
            self._names[key] = str(source.add(single, free))
        return self._names[key]


def _reader(read: list[GlyphRenderer[Any]], panel: Panel, *, dates: bool) -> HoverTool:
    when = "@x{%F %H:%M}" if dates else "@x{0.00}"
    named = any(series.names for series in panel.series)
    unit = panel.y_label.rpartition("(")[2].rstrip(")") if panel.y_label.endswith(")") else ""
    value = f"@$name{{0.0[00]}} {unit}"
    return HoverTool(
        renderers=read,
        tooltips=[("", "@point"), ("", f"{when}, {value}")] if named else [("$name", value), ("", when)],
        formatters={"@x": "datetime"} if dates else {},
        mode="vline" if len(read) <= _MAX_READ_AT_ONCE and not named else "mouse",
        point_policy="follow_mouse",
    )


def _dress(plot: Any, panel: Panel) -> None:
    """Colours and sizes of the page."""
    for axis in (plot.xaxis, plot.yaxis):
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = _FONT_SIZE
        axis.axis_label_text_color = axis.major_label_text_color = INK
        axis.axis_line_color = axis.major_tick_line_color = "#999999"
        axis.minor_tick_line_color = None
        axis.axis_label_standoff = 4
        axis.major_label_policy = NoOverlap(min_distance=6)  # a telephone is narrow
    plot.yaxis.axis_label = panel.y_label
    plot.yaxis.ticker.desired_num_ticks = 4
    plot.grid.grid_line_color = "#E3E3E3"
    plot.outline_line_color = None
    if panel.title:
        plot.title.text = panel.title
        plot.title.text_font_size = _FONT_SIZE
        plot.title.text_color = INK


def _draw_behind(plot: Any, grey: Series, label: str, columns: _Columns) -> None:
    """Bars on a separate axis, to the right."""
    reach = 1.15 * float(np.nanmax(np.abs(grey.y), initial=1e-9))
    plot.extra_y_ranges = {_BEHIND: Range1d(-reach, reach)}
    axis = LinearAxis(y_range_name=_BEHIND, axis_label=label)
    axis.axis_label_text_font_style = "normal"
    axis.axis_label_text_font_size = axis.major_label_text_font_size = _FONT_SIZE
    axis.axis_label_text_color = axis.major_label_text_color = _GREY
    axis.axis_line_color = axis.minor_tick_line_color = None
    axis.ticker.desired_num_ticks = 4
    plot.add_layout(axis, "right")
    top, bottom = columns.add(grey.x, grey.y, grey.label), columns.add(grey.x, 0.0 * grey.y, "nothing")
    plot.varea_step(
        x="x", y1=bottom, y2=top, source=columns.source(grey.x), step_mode="after", name=grey.label,
        fill_color=BACKGROUND, fill_alpha=0.28, y_range_name=_BEHIND,
    )  # fmt: skip


def _glyphs(plot: Any, drawn: list[Series], columns: _Columns, y_label: str) -> Iterator[GlyphRenderer[Any]]:
    """Draw each series, named by its label (the legend) and read from the column of that name."""
    for series in drawn:
        name = series.label or y_label
        y = columns.add(series.x, series.y, name)
        source = columns.source(series.x)
        common = {"source": source, "name": series.label if series.kind == "band" else y}
        line = {
            "line_color": series.colour,
            "line_width": 1.6,
            "line_dash": "dashed" if series.dashed else "solid",
        }
        if series.names:
            source.data["point"] = list(series.names)
        match series.kind:
            case "line":
                yield plot.line("x", y, **line, **common)
            case "step":
                yield plot.step("x", y, mode="after", **line, **common)
            case "dots":
                size = 4 if len(series.x) > _FEW_DOTS else 7
                yield plot.scatter("x", y, size=size, color=series.colour, **common)
            case "star":
                yield plot.scatter("x", y, size=15, marker="star", color=series.colour, **common)
            case "band":
                edge = 0.0 * series.y if series.base is None else series.base
                base = columns.add(series.x, edge, f"below {name}")
                yield plot.varea_step(
                    x="x", y1=base, y2=y, step_mode="after", fill_color=series.colour, **common
                )


def _numbers(x: Values) -> Values:
    """Instants in milliseconds, hours in single precision."""
    dates = np.issubdtype(x.dtype, np.datetime64)
    return x.astype("datetime64[ms]").astype(np.float64) if dates else x.astype(np.float32)
