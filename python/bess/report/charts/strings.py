"""State of every string over time."""

from __future__ import annotations

import numpy as np

from bess.report.charts.long_runs import MAX_CURVES, curve, daily, held, string_curves
from bess.report.data import Result, Results, TimeAxis, dataset_of, event_spans, named, with_initial
from bess.report.drawing.chart import Chart, Panel, Series
from bess.report.drawing.style import BACKGROUND, told_apart


def strings(result: Result) -> Chart:
    """SOC and mean temperature of every string, with the demand behind.

    Of a run of more than a month: the daily mean of every string, behind them the daily range over all
    strings.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    n_strings = dataset.sizes["string"]
    demand = None
    if not time.daily:
        (demand,) = curve(time, dataset["demand_kw"].values, BACKGROUND, "demand, positive = discharge")
    panels = []
    for variable, label, limits in (
        ("soc", "SOC", (-0.02, 1.02)),
        ("temperature_c", "Temperature (°C)", None),
    ):
        states = with_initial(dataset, variable)
        lines: list[Series] = []
        if time.daily and n_strings <= MAX_CURVES:
            days, low, _, high = daily(time, states[1:])
            base = held(low.min(axis=1))
            lines.append(Series(days, held(high.max(axis=1)), "#DDDDDD", "daily range", "band", base))
        lines += string_curves(time, states, among=2 * n_strings)
        panels.append(Panel(label, tuple(lines), demand, "Demand (kW)", y_limits=limits))
    return Chart(time.label, tuple(panels), panel_height_in=1.75, spans=event_spans(dataset, time))


def string_spread(results: Results) -> Chart:
    """Largest difference between strings in SOC and in mean temperature, for one result or several."""
    soc: list[Series] = []
    temperature: list[Series] = []
    datasets = named(results)
    label = ""
    for name, dataset, colour, dashed in told_apart(datasets):
        time = TimeAxis(dataset)
        label = time.label
        for variable, lines, factor in (("soc", soc, 100.0), ("temperature_c", temperature, 1.0)):
            spread = factor * np.ptp(with_initial(dataset, variable), axis=1)
            lines += curve(time, spread, colour, name, dashed=dashed)
    return Chart(
        label,
        (Panel("SOC spread (points)", tuple(soc)), Panel("Temperature spread (K)", tuple(temperature))),
        panel_height_in=1.4,
    )
