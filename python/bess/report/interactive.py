"""Charts as plain dictionaries for plotly.js; plotly's Python side is not needed to make them."""

from __future__ import annotations

from typing import Any

import numpy as np

from bess.report.chart import Chart, Panel, Series, Values
from bess.report.style import BACKGROUND, INK

_ALONE_PX = 300
_PANEL_PX = 200
_SMALL_PANEL_PX = 130
_MOST_TALL_PANELS = 4
_GAP_PX = 26
_TITLE_PX = 18
_MOST_LEGEND_ENTRIES = 10
_GRID = "#E3E3E3"


def plotly_figure(chart: Chart) -> dict[str, Any]:
    """Return ``{"data": [...], "layout": {...}}``; panels stand one above the other and share the time axis.

    Panels that the printed figure sets side by side are stacked as well: a telephone is narrow.
    """
    count = len(chart.panels)
    panel_px = _ALONE_PX if count == 1 else (_PANEL_PX if count <= _MOST_TALL_PANELS else _SMALL_PANEL_PX)
    title_px = _TITLE_PX if any(panel.title for panel in chart.panels) else 0
    plot_px = panel_px * count + (_GAP_PX + title_px) * (count - 1)
    height, gap = panel_px / plot_px, (_GAP_PX + title_px) / plot_px
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "height": plot_px + 110,
        "margin": {"l": 62, "r": 58, "t": 12, "b": 48},
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": INK},
        "hovermode": "x unified" if count == 1 else "closest",
        "legend": {
            "orientation": "h",
            "itemsizing": "constant",
            "x": 0,
            "y": 1.0 + title_px / plot_px,
            "yanchor": "bottom",
        },
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "annotations": [],
        "xaxis": {
            "anchor": f"y{count if count > 1 else ''}",
            "title": {"text": chart.x_label},
            "gridcolor": _GRID,
            "zeroline": False,
            "automargin": True,
        },
    }
    shown: set[str] = set()
    for index, panel in enumerate(chart.panels):
        top = 1.0 - index * (height + gap)
        _panel(data, layout, panel, index, (max(top - height, 0.0), top), shown, count)
    names = {trace["name"] for trace in data if trace["showlegend"]}
    if len(names) > _MOST_LEGEND_ENTRIES:
        # A telephone would show nothing but the legend; pointing at a line still names it.
        layout["showlegend"] = False
    return {"data": data, "layout": layout}


def _panel(
    data: list[dict[str, Any]],
    layout: dict[str, Any],
    panel: Panel,
    index: int,
    domain: tuple[float, float],
    shown: set[str],
    count: int,
) -> None:
    number = "" if index == 0 else str(index + 1)
    axis: dict[str, Any] = {
        "domain": list(domain),
        "title": {"text": panel.y_label, "standoff": 4},
        "gridcolor": _GRID,
        "zerolinecolor": "#BBBBBB",
        "automargin": True,
        "tickmode": "auto",
        "tickformat": "~g" if panel.log else "",
        "type": "log" if panel.log else "linear",
    }
    if panel.log:
        shown_y = np.concatenate([series.y.astype(float) for series in panel.series])
        low, high = np.nanmin(shown_y), np.nanmax(shown_y)
        # Decades only, or 1, 2 and 5 of each.
        axis["dtick"] = 1 if high > 50.0 * low else "D2"
    if panel.y_limits is not None:
        axis["range"] = list(np.log10(panel.y_limits) if panel.log else panel.y_limits)
    if panel.background is not None:
        behind = f"{count + index + 1}"
        reach = 1.15 * float(np.nanmax(np.abs(panel.background.y), initial=1e-9))
        layout[f"yaxis{behind}"] = {
            "domain": list(domain),
            "side": "right",
            "anchor": "x",
            "range": [-reach, reach],
            "showgrid": False,
            "title": {"text": panel.background_label, "standoff": 4},
            "color": "#6A6A6A",
            "zeroline": False,
            "automargin": True,
            "tickmode": "auto",
        }
        axis["overlaying"] = f"y{behind}"
        data += _traces(panel.background, f"y{behind}", shown, fill=True)
    layout[f"yaxis{number}"] = axis
    for series in panel.series:
        data += _traces(series, f"y{number}", shown)
    if panel.title:
        layout["annotations"].append(
            {
                "xref": "paper",
                "x": 0,
                "xanchor": "left",
                "yref": "paper",
                "y": domain[1],
                "yanchor": "bottom",
                "text": panel.title,
                "showarrow": False,
                "font": {"size": 12},
            }
        )


def _traces(series: Series, axis: str, shown: set[str], *, fill: bool = False) -> list[dict[str, Any]]:
    trace: dict[str, Any] = {
        "type": "scatter",
        "x": _column(series.x),
        "y": _column(series.y),
        "yaxis": axis,
        "name": series.label,
        "legendgroup": series.label,
        "showlegend": bool(series.label) and series.label not in shown,
        "mode": "markers" if series.kind in ("dots", "star") else "lines",
    }
    shown.add(series.label)
    stepped = fill or series.kind in ("step", "band")
    trace["line"] = {
        "color": series.colour,
        "width": 1.6,
        "shape": "hv" if stepped else "linear",
        "dash": "dash" if series.dashed else "solid",
    }
    if not series.label:
        trace["hoverinfo"] = "skip"
    if series.names:
        trace |= {"text": list(series.names), "hovertemplate": "%{text}<br>%{x:.2f}, %{y:.2f}<extra></extra>"}
    match series.kind:
        case "dots":
            trace["marker"] = {"color": series.colour, "size": 4 if len(series.x) > 100 else 7}
        case "star":
            trace["marker"] = {"color": series.colour, "size": 15, "symbol": "star"}
        case "band":
            trace |= {"fill": "tonexty", "fillcolor": series.colour}
            trace["line"]["width"] = 0
    if fill:
        trace |= {"fill": "tozeroy", "fillcolor": "rgba(154,154,154,0.28)"}
        trace["line"] |= {"width": 0, "color": BACKGROUND}
    if series.kind != "band":
        return [trace]
    base = np.zeros(len(series.y)) if series.base is None else series.base
    floor = {
        **trace,
        "y": _column(base),
        "fill": "none",
        "showlegend": False,
        "hoverinfo": "skip",
    }
    return [floor, trace]


def _column(values: Values) -> list[Any]:
    """Numbers to five digits (JSON has no NaN: null makes a gap), instants as text in UTC."""
    if np.issubdtype(values.dtype, np.datetime64):
        return [str(value) for value in np.datetime_as_string(values, unit="s")]
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values.astype(float)]
