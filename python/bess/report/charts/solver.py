"""Effort and optimality gap of the optimiser in every step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bess.report.charts.long_runs import thin
from bess.report.data import Result, TimeAxis, dataset_of
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import AVAILABILITY, BATTERY, DISCHARGE, INVERTER

_SMALLEST_GAP_PCT = 1e-4
_MOST_DOTS = 800


def solver_effort(result: Result, solve_time_s: ArrayLike | None = None) -> Chart:
    """Solve time, nodes and gap of every step; steps that fell back are marked.

    Parameters
    ----------
    result
        Result of a policy that optimises.
    solve_time_s
        Wall-clock time of each step [s], as in ``log.jsonl``; without it that panel is left out.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    nodes = dataset["solver_nodes"].values.astype(float)
    gaps = (
        ("rigorous gap", 100.0 * dataset["solver_gap"].values, DISCHARGE),
        ("search gap", 100.0 * dataset["solver_search_gap"].values, BATTERY),
    )
    panels = []
    if solve_time_s is not None:
        spent = 1e3 * np.asarray(solve_time_s, dtype=float)
        panels.append(
            Panel("Solve time (ms)", (_dots(time.start, spent, INVERTER),), log=bool(np.any(spent > 0)))
        )
    effort = [_dots(time.start, nodes, DISCHARGE)]
    fell_back = dataset["fallback"].values.astype(bool)
    if fell_back.any():
        effort.append(_dots(time.start[fell_back], nodes[fell_back], AVAILABILITY, "fell back"))
    panels.append(Panel("Nodes", tuple(effort)))
    shown = tuple(
        _dots(time.start, np.maximum(gap, _SMALLEST_GAP_PCT), colour, label)
        for label, gap, colour in gaps
        if np.any(np.isfinite(gap))
    )
    if shown:
        panels.append(Panel("Gap (%)", shown, log=True))
    return Chart(time.label, tuple(panels), panel_height_in=1.25)


def _dots(x: Values, y: Values, colour: str, label: str = "") -> Series:
    return Series(*thin(x, y, _MOST_DOTS), colour, label, "dots")
