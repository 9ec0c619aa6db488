"""Loss breakdown of one run, and comparison of several runs."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bess.report.charts.kpi_figures import check_drawable
from bess.report.data import Result, dataset_of
from bess.report.drawing.style import (
    AUXILIARY,
    AVAILABILITY,
    BACKGROUND,
    BATTERY,
    CHARGE,
    DERATING,
    DISCHARGE,
    HYSTERESIS,
    INK,
    INVERTER,
    new_figure,
    styled,
)
from bess.simulation.analysis import energy_flow as analysis
from bess.simulation.analysis.catalogue import KpisByRun, kpi

_UNDELIVERED = {
    "unmet_kwh": BACKGROUND,
    "derating_loss_kwh": DERATING,
    "availability_loss_kwh": AVAILABILITY,
}
_CONVERSION = {"inverter_loss_kwh": INVERTER, "battery_loss_kwh": BATTERY}
_BESIDE = {"hysteresis_loss_kwh": HYSTERESIS, "auxiliary_kwh": AUXILIARY}
"""Further losses, not part of ``lost_kwh``; not in every run."""
_NOTHING_KWH = 0.05
_FLOW_IN, _FLOW_ROW_IN = 4.6, 0.19
_WIDTH_IN = 5.6
_ROW_IN = 0.29


@styled
def energy_flow(result: Result) -> Figure:
    """From the grid into store and back: each direction with what it did not deliver and what it lost.

    One bar for each step, on an axis from zero; what is nothing has none.

    Parameters
    ----------
    result
        What ``bess.run`` returned, or its dataset.
    """
    rows = _flow_rows(analysis.energy_flow(dataset_of(result)))
    figure = new_figure(_FLOW_IN, 0.55 + _FLOW_ROW_IN * len(rows))
    axes = figure.subplots()
    for place, (_, low, high, colour) in enumerate(rows):
        total = colour in (CHARGE, DISCHARGE, INK)
        axes.barh(place, high - low, 0.86 if total else 0.6, left=low, color=colour)
        axes.annotate(
            f"{'' if total else '− '}{kpi('lost_kwh').number(high - low)}", (high, place), xytext=(3, 0),
            textcoords="offset points", va="center", fontsize=7, fontweight="bold" if total else "normal",
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [row[0] for row in rows])
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.16 * max(row[2] for row in rows) or 1.0)
    axes.set_xlabel("Energy (kWh)")
    axes.grid(visible=False, axis="y")
    return figure


def _flow_rows(flow: analysis.EnergyFlow) -> list[tuple[str, float, float, str]]:
    """Label, both ends and colour of each bar, from above: down to what is in store, and on to the grid."""
    charge, discharge = flow.charge, flow.discharge

    def missing(of: analysis.Direction, string: str) -> list[tuple[str, float, str]]:
        return [
            ("Unmet demand", of.unmet_kwh, BACKGROUND),
            ("Derating loss", of.derating_kwh, DERATING),
            (f"Availability loss ({string})", of.availability_kwh, AVAILABILITY),
        ]

    def losses(of: analysis.Direction) -> list[tuple[str, float, str]]:
        return [
            ("Inverters", of.inverter_kwh, INVERTER),
            ("Batteries", of.battery_kwh, BATTERY),
            ("Hysteresis", of.hysteresis_kwh, HYSTERESIS),
        ]

    beside = [("Standby", flow.standby_kwh, BACKGROUND), ("Cooling", flow.auxiliary_kwh, AUXILIARY)]
    blocks = [
        ("Charging demand", charge.asked_kwh, INK, missing(charge, "full")),
        ("Grid import", flow.taken_kwh, CHARGE, [*beside, *losses(charge)]),
        ("Stored", charge.store_kwh, CHARGE, []),
        ("From storage", discharge.store_kwh, DISCHARGE, losses(discharge)),
        ("Grid export", discharge.grid_kwh, DISCHARGE, []),
        ("Discharging demand", discharge.asked_kwh, INK, missing(discharge, "empty")),
    ]
    rows = []
    for label, total, colour, parts in blocks:
        rows.append((label, 0.0, total, colour))
        left = total
        for name, size, shade in parts:
            if size > _NOTHING_KWH:
                rows.append((name, left - size, left, shade))
            left -= size
    return rows


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
    axes.set_xlabel("Undelivered energy and losses (kWh)")
    axes.grid(visible=False, axis="y")
    handles = [Patch(color=colour, label=kpi(part).label) for part, colour in parts.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure
