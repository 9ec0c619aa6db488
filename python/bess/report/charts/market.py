"""Market studies: price, energy sold and bought, and stored energy."""

from __future__ import annotations

import numpy as np

from bess.errors import InputError
from bess.report.charts.long_runs import curve, daily, held
from bess.report.data import Result, TimeAxis, dataset_of, step_h, with_initial
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import BATTERY, CHARGE, DERATING, DISCHARGE, INK, INVERTER


def market_dispatch(result: Result) -> Chart:
    """Price, dispatch and mean SOC of a market study; of more than a month, the energy of each day.

    Where the dispatch said what it expected to be delivered, that stands beside what was.

    Raises
    ------
    InputError
        The run has no prices.
    """
    dataset = dataset_of(result)
    if "price_eur_mwh" not in dataset:
        raise InputError("the result has no price_eur_mwh: it is not a market study")
    time = TimeAxis(dataset)
    delivered = dataset["delivered_kw"].values.sum(axis=1)
    planned = dataset["expected_kw"].values if "expected_kw" in dataset else None
    price = curve(time, dataset["price_eur_mwh"].values, INVERTER, kind="step")
    if time.daily:
        power = Panel("Energy per day (kWh)", _days(time, dataset["delivered_kw"].values, step_h(dataset)))
    else:
        lines = curve(time, delivered, DISCHARGE, "delivered, positive = sold", kind="step")
        lines += curve(time, dataset["demand_kw"].values, INK, "demand", kind="step", dashed=True)
        if planned is not None:
            lines += curve(time, planned, DERATING, "planned to be delivered", kind="step", dashed=True)
        power = Panel("Power (kW)", tuple(lines))
    soc = curve(time, with_initial(dataset, "soc").mean(axis=1), BATTERY)
    panels = [Panel("Price (EUR/MWh)", tuple(price)), power]
    if time.daily and planned is not None:
        short = np.abs(planned) - np.abs(delivered)
        panels.append(Panel("Short of plan (kWh/day)", (_shortfall(time, short, step_h(dataset)),)))
    panels.append(Panel("Mean SOC", tuple(soc), y_limits=(-0.02, 1.02)))
    return Chart(time.label, tuple(panels), panel_height_in=1.35)


def _shortfall(time: TimeAxis, short_kw: Values, dt_h: float) -> Series:
    """Dispatch deviation: planned minus delivered energy of each day; negative if the plan was exceeded."""
    days, _, mean, _ = daily(time, short_kw)
    return Series(days, held(mean * time.steps_per_day * dt_h), DERATING, "planned less delivered", "band")


def _days(time: TimeAxis, delivered_kw: Values, dt_h: float) -> tuple[Series, ...]:
    """Sold upwards, bought downwards."""
    bands = []
    for sign, colour, label in ((1.0, DISCHARGE, "sold"), (-1.0, CHARGE, "bought")):
        power = np.maximum(sign * delivered_kw, 0.0).sum(axis=1)
        days, _, mean, _ = daily(time, power)
        energy = sign * mean * time.steps_per_day * dt_h
        bands.append(Series(days, held(energy), colour, label, "band"))
    return tuple(bands)
