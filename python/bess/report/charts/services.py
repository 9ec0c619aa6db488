"""Grid services: demand on the plant and compliance."""

from __future__ import annotations

import numpy as np

from bess.errors import InputError
from bess.report.charts.long_runs import curve
from bess.report.data import Result, TimeAxis, dataset_of, with_initial
from bess.report.drawing.chart import Chart, Panel
from bess.report.drawing.style import AVAILABILITY, BACKGROUND, BATTERY, CHARGE, DISCHARGE, INK
from bess.simulation.analysis.services import draw_kw, is_reserve, is_site


def service(result: Result) -> Chart:
    """Frequency, power and required window of a reserve; load, draw and state of charge behind a meter.

    Raises
    ------
    InputError
        The run is not of a service.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    soc = curve(time, with_initial(dataset, "soc").mean(axis=1), BATTERY, "mean over the strings")
    if is_reserve(dataset):
        frequency = curve(time, dataset["frequency_mhz"].values, INK, kind="step")
        power = curve(time, dataset["delivered_kw"].values.sum(axis=1), DISCHARGE, "delivered", kind="step")
        power += curve(time, dataset["schedule_kw"].values, AVAILABILITY, "agreed ahead", kind="step")
        for name, label in (("soc_low", "required window"), ("soc_high", "")):
            soc += curve(time, dataset[name].values, AVAILABILITY, label, kind="step", dashed=True)
        first = Panel("Frequency (mHz from nominal)", tuple(frequency))
    elif is_site(dataset):
        _, after, delivered = draw_kw(dataset)
        load = curve(time, dataset["load_kw"].values, BACKGROUND, "load", kind="step")
        if np.any(dataset["generation_kw"].values > 0.0):
            load += curve(time, dataset["generation_kw"].values, CHARGE, "generation", kind="step")
        load += curve(time, after, INK, "drawn from the grid", kind="step")
        if "grid_limit_kw" in dataset:
            limit = dataset["grid_limit_kw"].values
            load += curve(time, limit, AVAILABILITY, "limit", kind="step", dashed=True)
        power = curve(time, delivered, DISCHARGE, "delivered", kind="step")
        first = Panel("Site (kW)", tuple(load))
    else:
        raise InputError("the result has neither response_kw nor load_kw: it is not of a service")
    panels = (first, Panel("Plant (kW)", tuple(power)), Panel("SOC", tuple(soc), y_limits=(-0.02, 1.02)))
    return Chart(time.label, panels, panel_height_in=1.35)
