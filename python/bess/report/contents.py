"""Figures of a page, with captions and alternative texts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from bess.control.policies.planned import PLANNED
from bess.report import figures
from bess.report.charts import operation
from bess.report.charts.maps import MIN_MAP_DAYS, days_of, months_of
from bess.report.data import Results, TimeAxis
from bess.report.drawing.chart import Chart
from bess.report.runs import Run
from bess.simulation.analysis.services import is_reserve, is_site

MAX_COMPARED_RUNS = 8
"""Maximum number of scenarios shown side by side; more are shown as a table and a front."""
_MIN_MONTHS = 3
_MIN_DRAWN_SPREAD = 0.005


@dataclass(frozen=True)
class FigureSpec:
    """One figure of the page: ``make`` gives a chart (for print and interactive) or a figure (print only)."""

    name: str
    title: str
    caption: str
    make: Callable[[], Chart | Figure]


def comparison(runs: Mapping[str, Run]) -> Iterator[FigureSpec]:
    """Figures that compare several runs."""
    results = {name: run.dataset for name, run in runs.items()}
    yield FigureSpec(
        "losses",
        "Unmet and undelivered energy, and all losses",
        "Shorter is better. The figure at the end of each bar is the sum of its parts; unmet demand, "
        "hysteresis and cooling are not part of the KPI “Undelivered + losses”.",
        partial(figures.losses_compared, {name: run.kpis for name, run in runs.items()}),
    )
    together = len({run.dataset["time"].values.tobytes() for run in runs.values()}) == 1
    if together:  # on one time axis
        first = next(iter(runs.values()))
        derating_c = first.system.strings[0].derating.start_c
        yield FigureSpec(
            "mean-temperature",
            "Mean temperature",
            "Mean over strings; derating begins at the broken line.",
            partial(operation.mean_temperature, results, derating_start_c=derating_c),
        )
    yield _durations(results)
    if together and any(_spread_apart(run) for run in runs.values()):
        yield _spread(results)


def first_screen(run: Run) -> Iterator[FigureSpec]:
    """The figure next to the summary of a run."""
    yield FigureSpec(
        "flow",
        "Energy, grid to grid",
        "Undelivered energy and losses of each direction; the axis begins at zero.",
        partial(figures.energy_flow, run.dataset),
    )


def overview(run: Run) -> Iterator[FigureSpec]:
    """Figures of one run as a whole."""
    if months_of(run.dataset) >= _MIN_MONTHS:
        yield FigureSpec(
            "months",
            "Month by month",
            "Income upwards and costs downwards, energy of both directions, losses, and full cycles."
            if "price_eur_mwh" in run.dataset
            else "Energy of both directions, losses, and full cycles.",
            partial(figures.monthly_bars, run.dataset),
        )
    if days_of(run.dataset) >= MIN_MAP_DAYS:
        yield FigureSpec(
            "map",
            "Hour by hour, day by day",
            "Every step of the run: days from left to right, hours of the day (UTC) from bottom to top.",
            partial(figures.heat_maps, run.dataset),
        )
    yield _durations(run.dataset)


def over_time(run: Run) -> Iterator[FigureSpec]:
    """Figures of one run along its time."""
    data = run.dataset
    daily = TimeAxis(data).daily
    if is_reserve(data) or is_site(data):
        yield FigureSpec(
            "service",
            "Service",
            "Frequency, delivered power, and the state of charge within the required window."
            if is_reserve(data)
            else "Load and generation, grid import, and delivered power of the plant.",
            partial(operation.service, data),
        )
    elif "price_eur_mwh" in data:
        yield FigureSpec(
            "market",
            "Market",
            "Price (mean and range of each day), energy of each day, dispatch deviation of plans that expect "
            "losses, mean state of charge."
            if daily
            else "Price, dispatch and mean state of charge.",
            partial(operation.market_dispatch, data),
        )
    yield FigureSpec(
        "strings",
        "State of the strings",
        "State of charge and temperature: daily mean of every string, daily range over all of them in grey."
        if daily
        else "State of charge and mean temperature of every string, with the demand in grey.",
        partial(operation.strings, data),
    )
    if days_of(data) < MIN_MAP_DAYS:  # of longer runs the map shows power: stacks would be blocks
        yield FigureSpec(
            "power",
            "Power of the strings",
            "Requested: delivered power, derating loss and availability loss (discharge upwards, charge "
            "downwards). Loss: in inverters and batteries.",
            partial(operation.power_split, data),
        )
    if "reactive_kvar" in data:
        yield FigureSpec(
            "reactive",
            "Reactive power",
            "Reactive power of the plant (demand and delivered) and of every string, and apparent power of "
            "its inverter.",
            partial(operation.reactive_power, data),
        )
    if data.sizes["string"] > 1:
        yield FigureSpec(
            "inverters",
            "Inverters on and off",
            "Hours on per day of every inverter." if daily else "Operating state of every inverter.",
            partial(figures.inverter_pattern, data),
        )
    if _spread_apart(run) and not daily:
        yield _spread(data)
    if "end_of_life" in data:
        yield FigureSpec(
            "health",
            "State of health",
            "Capacity and resistance over those of the system file, and the cost of the capacity lost.",
            partial(operation.state_of_health, data),
        )
    if "node_temperature_c" in data:
        yield FigureSpec(
            "nodes",
            "Temperature along the air path",
            "Temperature of every node over time, for each string.",
            partial(figures.node_temperatures, data),
        )


def optimiser(run: Run) -> Iterator[FigureSpec]:
    """Effort of the optimiser; none for policies without one."""
    data = run.dataset
    certified = data["solver_status"].values != PLANNED
    if np.isfinite(data["solver_gap"].values[certified]).any() or (data["solver_nodes"].values > 0).any():
        yield FigureSpec(
            "solver",
            "Effort of the optimiser",
            "Rigorous gap: to a bound on the nonlinear control model. Search gap: of the convexified "
            "program, on which the search stops. Gaps below 0.0001 % stand at the lower edge.",
            partial(operation.solver_effort, data, run.solve_time_s),
        )


def _durations(results: Results) -> FigureSpec:
    return FigureSpec(
        "durations",
        "Duration curves",
        "Share of time with at least this plant power, or this temperature of the hottest string.",
        partial(operation.duration_curves, results),
    )


def _spread(results: Results) -> FigureSpec:
    return FigureSpec(
        "spread",
        "Differences between strings",
        "Largest minus smallest value over the strings.",
        partial(operation.string_spread, results),
    )


def _spread_apart(run: Run) -> bool:
    """Whether the SOC differences of the strings were ever visible."""
    return bool(np.ptp(run.dataset["soc"].values, axis=1).max() > _MIN_DRAWN_SPREAD)
