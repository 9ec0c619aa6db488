"""Reactive power: demand, supply, and apparent power of the inverters."""

from __future__ import annotations

import numpy as np

from bess.errors import InputError
from bess.report.charts.long_runs import curve, string_curves
from bess.report.data import Result, TimeAxis, dataset_of, event_spans
from bess.report.drawing.chart import Chart, Panel, Values
from bess.report.drawing.style import AVAILABILITY, INK


def reactive_power(result: Result) -> Chart:
    """Reactive power of the plant, and of every string its reactive and its apparent power.

    Raises
    ------
    InputError
        The run carried no reactive power.
    """
    dataset = dataset_of(result)
    if "reactive_kvar" not in dataset:
        raise InputError("the result has no reactive_kvar; ask for it in the study's [reactive]")
    time = TimeAxis(dataset)
    q_kvar = dataset["reactive_kvar"].values
    apparent_kva = np.hypot(dataset["delivered_kw"].values, q_kvar)
    plant = curve(time, q_kvar.sum(axis=1), INK, "carried", kind="step")
    asked_kvar = dataset["reactive_demand_kvar"].values
    plant += curve(time, asked_kvar, AVAILABILITY, "asked", kind="step", dashed=True)
    among = q_kvar.shape[1]
    strings = string_curves(time, q_kvar, among)
    loading = string_curves(time, apparent_kva, among)
    panels = (
        Panel("Plant (kvar)", tuple(plant), y_limits=_with_zero(q_kvar.sum(axis=1), asked_kvar)),
        Panel("Strings (kvar)", tuple(strings)),
        Panel("Strings (kVA)", tuple(loading)),
    )
    return Chart(time.label, panels, panel_height_in=1.35, spans=event_spans(dataset, time))


def _with_zero(*values: Values) -> tuple[float, float]:
    """Limits that hold zero and all values; of what is constant, rounding alone would be seen otherwise."""
    low, high = (float(end([end(each) for each in values] + [0.0])) for end in (np.min, np.max))
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin
