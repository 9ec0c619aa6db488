"""How strings age."""

from __future__ import annotations

import numpy as np

from bess.report.charts.long_runs import curve
from bess.report.data import Result, TimeAxis, dataset_of, event_spans, with_initial
from bess.report.drawing.chart import Chart, Panel
from bess.report.drawing.style import colours


def state_of_health(result: Result) -> Chart:
    """Capacity and resistance of every string over those of the system file, and the cost of wear so far."""
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
        named = enumerate(colours(states.shape[1]))
        lines = [
            curve(time, states[:, i], colour, f"string {i}", among=states.shape[1], band=False)
            for i, colour in named
        ]
        panels.append(Panel(label, tuple(line for each in lines for line in each)))
    return Chart(time.label, tuple(panels), panel_height_in=1.4, spans=event_spans(dataset, time))
