"""Duration curves of power and temperature."""

from __future__ import annotations

import numpy as np

from bess.report.data import Results, named
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import INK, told_apart

_POINTS = 400


def duration_curves(results: Results) -> Chart:
    """Delivered power of the plant and temperature of its hottest string, each sorted from high to low.

    One point of a curve says for which share of the time the value was at least this high. For a single
    result the demand is drawn as well.
    """
    datasets = named(results)
    power: list[Series] = []
    temperature: list[Series] = []
    if len(datasets) == 1:
        (dataset,) = datasets.values()
        power.append(Series(*_sorted(dataset["demand_kw"].values), INK, "demand", dashed=True))
    for name, dataset, colour, dashed in told_apart(datasets):
        delivered = dataset["delivered_kw"].values.sum(axis=1)
        hottest = dataset["temperature_c"].values.max(axis=1)
        label = name or "delivered"
        power.append(Series(*_sorted(delivered), colour, label, dashed=dashed))
        temperature.append(Series(*_sorted(hottest), colour, name, dashed=dashed))
    return Chart(
        "Share of the time (%)",
        (Panel("Plant power (kW)", tuple(power)), Panel("Hottest string (°C)", tuple(temperature))),
        panel_height_in=1.7,
    )


def _sorted(values: Values) -> tuple[Values, Values]:
    if values.size == 1:  # a point would be no line
        return np.array([0.0, 100.0]), np.repeat(values, 2)
    falling = np.sort(values)[::-1]
    shown = np.unique(np.linspace(0, len(falling) - 1, _POINTS).astype(int))
    return 100.0 * (shown + 0.5) / len(falling), falling[shown]
