"""Charts as documents for BokehJS: drawn in the page by its own copy of the library, no network needed."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from importlib import resources

from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import DataRange1d

from bess.report.drawing.chart import Chart, spans_label
from bess.report.drawing.interactive_panel import plot_of
from bess.report.drawing.style import INK

_ALONE_PX = 300
_PANEL_PX = 190
_SMALL_PANEL_PX = 130
_MOST_TALL_PANELS = 4
_ID = re.compile(r'"p[0-9]{4,}"')


@dataclass(frozen=True)
class LegendEntry:
    """One entry of a legend, which the page shows as a button: what it hides is found by its label."""

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

    Panels that the printed figure sets side by side are stacked as well: a telephone is narrow.
    """
    count = len(chart.panels)
    height = _ALONE_PX if count == 1 else (_PANEL_PX if count <= _MOST_TALL_PANELS else _SMALL_PANEL_PX)
    x_range = DataRange1d(range_padding=0.01)
    plots = [
        plot_of(panel, x_range, height, chart.spans, chart.x_label if index == count - 1 else None)
        for index, panel in enumerate(chart.panels)
    ]
    layout = column(plots, sizing_mode="stretch_width", spacing=2)
    return _renumbered(json.dumps(json_item(layout), allow_nan=False, separators=(",", ":")))


def _renumbered(text: str) -> str:
    """Ids from 1 within each document: the library counts on, and the same chart gives the same text."""
    numbers: dict[str, str] = {}
    return _ID.sub(lambda found: numbers.setdefault(found[0], f'"p{len(numbers) + 1}"'), text)
