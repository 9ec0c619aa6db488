"""Ageing of the strings."""

from __future__ import annotations

import numpy as np

from bess.report.charts.long_runs import string_curves
from bess.report.data import Result, TimeAxis, dataset_of, event_spans, with_initial
from bess.report.drawing.chart import Chart, Panel


def state_of_health(result: Result) -> Chart:
    """Capacity and resistance of every string relative to the system file, and accumulated wear cost."""
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    cost_eur = np.cumsum(np.vstack([np.zeros(dataset.sizes["string"]), dataset["wear_eur"].values]), axis=0)
    rows = (
        ("Capacity (%)", 100.0 * with_initial(dataset, "soh_capacity")),
        ("Resistance (%)", 100.0 * with_initial(dataset, "soh_resistance")),
        ("Wear so far (EUR)", cost_eur),
    )
    panels = []
    for label, states in rows:
        panels.append(Panel(label, tuple(string_curves(time, states, among=states.shape[1]))))
    return Chart(time.label, tuple(panels), panel_height_in=1.4, spans=event_spans(dataset, time))
