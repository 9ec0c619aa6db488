"""Charts as documents for BokehJS, which the page contains: no network is needed."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final

import numpy as np
from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import (
    BasicTicker,
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
from bokeh.themes import Theme

from bess.report.drawing.chart import Chart, Panel, Series, Values, background_reach, spans_label
from bess.report.drawing.style import BACKGROUND_ALPHA, EVENT, EVENT_ALPHA, GRID, INK, SOFT_INK

_ALONE_PX = 300
_PANEL_PX = 190
_SMALL_PANEL_PX = 130
_MAX_TALL_PANELS = 4
_X_AXIS_PX = 46
_TITLE_PX = 22
_MAX_READ_AT_ONCE = 6
_FEW_DOTS = 100
_BEHIND = "behind"
_FONT_SIZE = "12px"
_ID = re.compile(r'"p[0-9]{4,}"')
_THEME: Final = Theme(
    json={
        "attrs": {
            "Plot": {"outline_line_color": None, "min_border_left": 62},
            "Toolbar": {"logo": None, "autohide": True},
            "Title": {"text_font_size": _FONT_SIZE, "text_color": INK},
            "Grid": {"grid_line_color": GRID},
            "Axis": {
                "axis_label_text_font_style": "normal",
                "axis_label_text_font_size": _FONT_SIZE,
                "axis_label_text_color": INK,
                "axis_label_standoff": 4,
                "major_label_text_font_size": _FONT_SIZE,
                "major_label_text_color": INK,
                "axis_line_color": "#999999",
                "major_tick_line_color": "#999999",
                "minor_tick_line_color": None,
            },
        }
    }
)


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
                entries.setdefault(series.label, LegendEntry(series.label, series.colour, kind))
    if chart.spans:
        entries["events"] = LegendEntry(spans_label(chart), EVENT, "event")
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
        _plot(panel, x_range, height, chart, chart.x_label if index == count - 1 else None)
        for index, panel in enumerate(chart.panels)
    ]
    layout = column(plots, sizing_mode="stretch_width", spacing=2)
    text = json.dumps(json_item(layout, theme=_THEME), allow_nan=False, separators=(",", ":"))
    # Ids from 1 in each document, so that the same chart gives the same text.
    numbers: dict[str, str] = {}
    return _ID.sub(lambda found: numbers.setdefault(found[0], f'"p{len(numbers) + 1}"'), text)


def _plot(panel: Panel, x_range: Any, height: int, chart: Chart, x_label: str | None) -> Any:
    """Return the plot of a panel; only one with ``x_label`` shows the axis that all share."""
    drawn = [series for series in panel.series if len(series.x)]
    dates = bool(drawn) and np.issubdtype(drawn[0].x.dtype, np.datetime64)
    zoom = BoxZoomTool(dimensions="width")
    plot = figure(
        height=height + (_X_AXIS_PX if x_label else 0) + (_TITLE_PX if panel.title else 0),
        sizing_mode="stretch_width",
        title=panel.title or None,
        x_axis_type="datetime" if dates else "linear",
        y_axis_type="log" if panel.log else "linear",
        x_axis_label=x_label,
        y_axis_label=panel.y_label,
        x_range=x_range,
        tools=[PanTool(dimensions="width"), zoom, WheelZoomTool(dimensions="width"), ResetTool()],
        active_drag=zoom,
        toolbar_location="right",
    )
    plot.axis.major_label_policy = NoOverlap(min_distance=6)  # for narrow screens
    plot.xaxis.visible = x_label is not None
    plot.yaxis.ticker.desired_num_ticks = 4
    for span in chart.spans:
        left, right = _numbers(np.array([span.start, span.end])).tolist()
        event = {"left": left, "right": right, "name": spans_label(chart)}
        plot.add_layout(BoxAnnotation(level="underlay", fill_color=EVENT, fill_alpha=EVENT_ALPHA, **event))
    sources: dict[bytes, ColumnDataSource] = {}
    if panel.background is not None:
        reach = background_reach(panel.background)
        plot.extra_y_ranges = {_BEHIND: Range1d(-reach, reach)}
        behind = LinearAxis(
            y_range_name=_BEHIND,
            axis_label=panel.background_label,
            axis_label_text_color=SOFT_INK,
            major_label_text_color=SOFT_INK,
            axis_line_color=None,
            ticker=BasicTicker(desired_num_ticks=4),
        )
        plot.add_layout(behind, "right")
        _glyph(plot, panel.background, sources, fill_alpha=BACKGROUND_ALPHA, y_range_name=_BEHIND)
    glyphs = [_glyph(plot, series, sources, panel.y_label) for series in drawn]
    if panel.y_limits is not None:
        plot.y_range = Range1d(*panel.y_limits)
    else:
        plot.y_range.renderers = glyphs  # the background has its own axis
    # A band would show its edge only.
    read = [glyph for glyph, series in zip(glyphs, drawn, strict=True) if series.kind != "band"]
    if read:
        plot.add_tools(_reader(read, panel, dates=dates))
    return plot


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


def _glyph(
    plot: Any, series: Series, sources: dict[bytes, ColumnDataSource], y_label: str = "", **place: Any
) -> GlyphRenderer[Any]:
    """Draw a series from the column of its label, by which the legend and the tooltip find it.

    Values are in single precision, finer than any screen."""
    name, x, y = series.label or y_label, _numbers(series.x), series.y.astype(np.float32)
    source = sources.setdefault(x.tobytes(), ColumnDataSource({"x": x}))  # series over the same x share it
    if not np.array_equal(source.data.get(name, y), y, equal_nan=True):
        source = ColumnDataSource({"x": x})  # the name is taken
    source.data[name] = y
    if series.names:
        source.data["point"] = list(series.names)
    place |= {"source": source, "name": name}
    line = {
        "line_color": series.colour,
        "line_width": 1.6,
        "line_dash": "dashed" if series.dashed else "solid",
    }
    match series.kind:
        case "line":
            return plot.line("x", name, **line, **place)
        case "step":
            return plot.step("x", name, mode="after", **line, **place)
        case "dots":
            size = 4 if len(series.x) > _FEW_DOTS else 7
            return plot.scatter("x", name, size=size, color=series.colour, **place)
        case "star":
            return plot.scatter("x", name, size=15, marker="star", color=series.colour, **place)
        case "band":
            base = f"below {name}"
            source.data[base] = np.broadcast_to(series.base, y.shape).astype(np.float32)
            place["fill_color"] = series.colour
            return plot.varea_step(x="x", y1=base, y2=name, step_mode="after", **place)


def _numbers(x: Values) -> Values:
    """Instants in milliseconds, hours in single precision."""
    dates = np.issubdtype(x.dtype, np.datetime64)
    return x.astype("datetime64[ms]").astype(np.float64) if dates else x.astype(np.float32)
