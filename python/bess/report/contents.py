"""Which figures a page holds, with captions and texts for those who cannot see them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from bess.analysis.services import is_reserve, is_site
from bess.policies.planned import PLANNED
from bess.report import charts, figures
from bess.report.charts.calendar import SHORTEST_MAP_DAYS, days_of, months_of
from bess.report.data import TimeAxis
from bess.report.drawing.chart import Chart
from bess.report.drawing.draw import draw
from bess.report.runs import Run

MOST_COMPARED = 8
"""More scenarios than this are shown as a table and a front, not side by side."""
_FEWEST_MONTHS = 3
_SPREAD_WORTH_DRAWING = 0.005


@dataclass(frozen=True)
class Exhibit:
    """One figure of the page: ``make`` gives a chart (for print and interactive) or a figure (print only)."""

    name: str
    title: str
    caption: str
    make: Callable[[], Chart | Figure]

    def drawn(self) -> tuple[Figure, Chart | None]:
        """Return the figure, and the chart behind it if there is one."""
        made = self.make()
        return (draw(made), made) if isinstance(made, Chart) else (made, None)


def comparison(runs: Mapping[str, Run]) -> Iterator[Exhibit]:
    """Figures that set several runs side by side."""
    kpis = {name: run.kpis for name, run in runs.items()}
    results = {name: run.dataset for name, run in runs.items()}
    yield Exhibit(
        "losses",
        "What was not delivered, and what was lost",
        "Shorter is better. The figure at the end of each bar is the sum of its parts.",
        partial(figures.losses_compared, kpis),
    )
    yield Exhibit(
        "radar",
        "Key figures compared",
        "Better is outwards; every axis runs from the worst to the best value met, written at its end.",
        partial(figures.kpi_radar, kpis),
    )
    together = _share_their_time(runs)
    if together:
        yield _mean_temperature(runs)
    yield Exhibit(
        "durations",
        "Duration curves",
        "For which share of the time the plant gave at least this power, and its hottest string was at least "
        "this hot.",
        partial(charts.duration_curves, results),
    )
    if together and any(_spread_apart(run) for run in runs.values()):
        yield Exhibit(
            "spread",
            "Differences between strings",
            "Largest minus smallest value over the strings.",
            partial(charts.string_spread, results),
        )


def overview(run: Run) -> Iterator[Exhibit]:
    """Figures of one run as a whole."""
    yield Exhibit(
        "losses",
        "Where the energy went",
        "From the energy asked for, charge and discharge added, to what is left of it after all losses.",
        partial(figures.loss_waterfall, run.kpis),
    )
    if months_of(run.dataset) >= _FEWEST_MONTHS:
        yield Exhibit(
            "months",
            "Month by month",
            "Income upwards and costs downwards, energy of both directions, losses, and full cycles."
            if "price_eur_mwh" in run.dataset
            else "Energy of both directions, losses, and full cycles.",
            partial(figures.monthly_bars, run.dataset),
        )
    if days_of(run.dataset) >= SHORTEST_MAP_DAYS:
        yield Exhibit(
            "map",
            "Hour by hour, day by day",
            "Every step of the run: days from left to right, hours of the day (UTC) from bottom to top.",
            partial(figures.heat_maps, run.dataset),
        )
    yield Exhibit(
        "durations",
        "Duration curves",
        "For which share of the time the plant gave at least this power, and its hottest string was at least "
        "this hot.",
        partial(charts.duration_curves, run.dataset),
    )


def over_time(run: Run) -> Iterator[Exhibit]:
    """Figures of one run along its time."""
    data = run.dataset
    daily = TimeAxis(data).daily
    if is_reserve(data) or is_site(data):
        yield Exhibit(
            "service",
            "Service",
            "Frequency, what the plant gave, and the state of charge within the required window."
            if is_reserve(data)
            else "What load and generation do, what the grid connection draws, and what the plant gives.",
            partial(charts.service, data),
        )
    elif "price_eur_mwh" in data:
        yield Exhibit(
            "market",
            "Market",
            "Price (mean and range of each day), energy of each day, what it fell short of the plan if there "
            "was one that expected losses, mean state of charge."
            if daily
            else "Price, dispatch and mean state of charge.",
            partial(charts.market_dispatch, data),
        )
    yield Exhibit(
        "strings",
        "State of the strings",
        "State of charge and temperature: daily mean of every string, daily range over all of them in grey."
        if daily
        else "State of charge and mean temperature of every string, demand behind.",
        partial(charts.strings, data),
    )
    if not daily:
        yield Exhibit(
            "power",
            "Power of the strings",
            "Requested: what was delivered, and what was lost to derating and to availability (discharge "
            "upwards, charge downwards). Loss: in inverters and batteries.",
            partial(charts.power_split, data),
        )
    if "reactive_kvar" in data:
        yield Exhibit(
            "reactive",
            "Reactive power",
            "Reactive power asked of the plant and carried, that of every string, and the apparent power of "
            "its inverter.",
            partial(charts.reactive_power, data),
        )
    if data.sizes["string"] > 1:
        yield Exhibit(
            "inverters",
            "Inverters on and off",
            "Hours on per day of every inverter." if daily else "Which inverter ran when.",
            partial(figures.inverter_pattern, data),
        )
    if _spread_apart(run) and not daily:
        yield Exhibit(
            "spread",
            "Differences between strings",
            "Largest minus smallest value over the strings.",
            partial(charts.string_spread, data),
        )
    if "end_of_life" in data:
        yield Exhibit(
            "health",
            "State of health",
            "Capacity and resistance over those of the system file, and the cost of the capacity lost.",
            partial(charts.state_of_health, data),
        )
    if "node_temperature_c" in data:
        yield Exhibit(
            "nodes",
            "Temperature along the air path",
            "Temperature of every node over time, for each string.",
            partial(figures.node_temperatures, data),
        )


def optimiser(run: Run) -> Iterator[Exhibit]:
    """What the optimiser spent; nothing for policies without one."""
    data = run.dataset
    certified = data["solver_status"].values != PLANNED
    if np.isfinite(data["solver_gap"].values[certified]).any() or (data["solver_nodes"].values > 0).any():
        yield Exhibit(
            "solver",
            "Effort of the optimiser",
            "Rigorous gap: to a bound on the nonlinear control model. Search gap: of the convexified "
            "program, on which the search stops. Gaps below 0.0001 % stand at the lower edge.",
            partial(charts.solver_effort, data, run.solve_time_s),
        )


def _mean_temperature(runs: Mapping[str, Run]) -> Exhibit:
    first = next(iter(runs.values()))
    return Exhibit(
        "mean-temperature",
        "Mean temperature",
        "Mean over strings; derating begins at the broken line.",
        partial(
            charts.mean_temperature,
            {name: run.dataset for name, run in runs.items()},
            derating_start_c=first.system.strings[0].derating.start_c,
        ),
    )


def _share_their_time(runs: Mapping[str, Run]) -> bool:
    """Whether all runs have the same steps, so that one axis serves for them."""
    first, *others = (run.dataset["time"].values for run in runs.values())
    return all(np.array_equal(first, other) for other in others)


def _spread_apart(run: Run) -> bool:
    """Whether the strings' SOCs were ever so far apart that it can be seen."""
    return bool(np.ptp(run.dataset["soc"].values, axis=1).max() > _SPREAD_WORTH_DRAWING)
