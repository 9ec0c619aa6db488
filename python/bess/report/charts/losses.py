"""Where the energy went that was asked for: one run step by step, several side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bess.analysis.catalogue import Kpis, KpisByRun, kpi
from bess.report.charts.kpi_figures import check_drawable
from bess.report.drawing.style import (
    AUXILIARY,
    AVAILABILITY,
    BACKGROUND,
    BATTERY,
    DERATING,
    DISCHARGE,
    HYSTERESIS,
    INK,
    INVERTER,
    new_figure,
    styled,
)

_UNDELIVERED = {
    "unmet_kwh": BACKGROUND,
    "derating_loss_kwh": DERATING,
    "availability_loss_kwh": AVAILABILITY,
}
_CONVERSION = {"inverter_loss_kwh": INVERTER, "battery_loss_kwh": BATTERY}
_BESIDE = {"hysteresis_loss_kwh": HYSTERESIS, "auxiliary_kwh": AUXILIARY}
"""Lost as well, and no part of ``lost_kwh``; not of every run."""
_NOTHING_KWH = 0.05
_WIDTH_IN = 5.6
_ROW_IN = 0.29


@styled
def loss_waterfall(kpis: Kpis) -> Figure:
    """From the energy asked for to what is left of it after all losses, one bar for each step.

    The axis starts where the steps can be seen, and says so.

    Parameters
    ----------
    kpis
        Of one run (``bess.kpis``).
    """
    check_drawable({"": kpis}, ("demand_kwh", "delivered_kwh", *_UNDELIVERED, *_CONVERSION))
    left = kpis["demand_kwh"]
    rows: list[tuple[str, float, float, str]] = [(kpi("demand_kwh").label, 0.0, left, INK)]
    for part, colour in _UNDELIVERED.items():
        rows.append((kpi(part).label, left - kpis[part], left, colour))
        left -= kpis[part]
    left = kpis["delivered_kwh"]
    rows.append((kpi("delivered_kwh").label, 0.0, left, DISCHARGE))
    for part, colour in (_CONVERSION | _BESIDE).items():
        rows.append((kpi(part).label, left - kpis.get(part, 0.0), left, colour))
        left -= kpis.get(part, 0.0)
    rows.append(("Delivered less losses", 0.0, left, DISCHARGE))
    rows = [row for row in rows if row[2] - row[1] > _NOTHING_KWH]
    floor = _floor(left, kpis["demand_kwh"])
    figure = new_figure(_WIDTH_IN, 0.75 + _ROW_IN * len(rows))
    axes = figure.subplots()
    for place, (_, low, high, colour) in enumerate(rows):
        start = max(low, floor)
        axes.barh(place, high - start, 0.7, left=start, color=colour)
        axes.annotate(
            kpi("lost_kwh").number(high - low), (high, place), xytext=(3, 0), textcoords="offset points",
            va="center", fontsize=7.5,
        )  # fmt: skip
        if place + 1 < len(rows):
            through = low if low > 0.0 else high
            axes.plot([through, through], [place - 0.35, place + 1.35], color=BACKGROUND, linewidth=0.6)
    axes.set_yticks(range(len(rows)), [row[0] for row in rows])
    axes.invert_yaxis()
    span = kpis["demand_kwh"] - floor
    axes.set_xlim(floor, kpis["demand_kwh"] + 0.13 * span if span > 0.0 else floor + 1.0)
    axes.set_xlabel("Energy (kWh)" if floor == 0.0 else f"Energy (kWh), axis starts at {floor:,.0f} kWh")
    axes.grid(visible=False, axis="y")
    return figure


@styled
def losses_compared(kpis: KpisByRun) -> Figure:
    """What each run did not deliver and what it lost, stacked; its sum at the end of the bar.

    Parameters
    ----------
    kpis
        KPIs of each run, by name.
    """
    check_drawable(kpis, (*_UNDELIVERED, *_CONVERSION))
    parts = {
        part: colour
        for part, colour in (_UNDELIVERED | _CONVERSION | _BESIDE).items()
        if any(entry.get(part, 0.0) > _NOTHING_KWH for entry in kpis.values())
    }
    figure = new_figure(_WIDTH_IN, 1.0 + _ROW_IN * len(kpis))
    axes = figure.subplots()
    places = np.arange(len(kpis))
    ends = np.zeros(len(kpis))
    for part, colour in parts.items():
        values = np.array([entry.get(part, 0.0) for entry in kpis.values()])
        axes.barh(places, values, 0.7, left=ends, color=colour)
        ends += values
    for place, end in zip(places, ends, strict=True):
        axes.annotate(
            kpi("lost_kwh").number(end), (end, place), xytext=(3, 0), textcoords="offset points",
            va="center", fontsize=7.5,
        )  # fmt: skip
    axes.set_yticks(places, list(kpis))
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.13 * max(float(ends.max()), _NOTHING_KWH))
    axes.set_xlabel("Not delivered or lost (kWh)")
    axes.grid(visible=False, axis="y")
    handles = [Patch(color=colour, label=kpi(part).label) for part, colour in parts.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure


def _floor(left: float, asked: float) -> float:
    """Half as far below what is left as the losses are long, in round numbers; zero if that is near."""
    span = asked - left
    floor = left - 0.5 * span
    if span <= 0.0 or floor < 0.4 * asked:
        return 0.0
    unit = 10.0 ** np.floor(np.log10(span))
    return float(unit * np.floor(floor / unit))
