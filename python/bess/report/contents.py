"""Which figures a page holds, with captions and texts for those who cannot see them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from bess.report import charts, figures
from bess.report.chart import Chart
from bess.report.data import TimeAxis
from bess.report.draw import draw
from bess.report.runs import Run

MOST_COMPARED = 8
"""More scenarios than this are shown as a table and a front, not side by side."""
MOST_DETAILED = 4
"""More scenarios than this are compared, but not shown one by one."""


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
    """Figures over all runs."""
    kpis = {name: run.kpis for name, run in runs.items()}
    shown = {"": next(iter(kpis.values()))} if len(kpis) == 1 else kpis
    results = {name: run.dataset for name, run in runs.items()}
    first = next(iter(runs.values()))
    start_c = first.system.strings[0].derating.start_c
    yield Exhibit(
        "kpis", "Efficiencies", "Key figures from the plant's record.", partial(figures.kpi_bars, shown)
    )
    if len(runs) > 1:
        yield Exhibit(
            "radar",
            "Scenarios compared",
            "Better is outwards; every axis runs from the worst to the best value met, written at its end.",
            partial(figures.kpi_radar, kpis),
        )
    yield Exhibit(
        "mean-temperature",
        "Mean temperature",
        "Mean over strings; derating begins at the broken line.",
        partial(
            charts.mean_temperature, results if len(runs) > 1 else first.dataset, derating_start_c=start_c
        ),
    )
    if first.dataset.sizes["string"] > 1:
        yield Exhibit(
            "spread",
            "Differences between strings",
            "Largest minus smallest value over the strings.",
            partial(charts.string_spread, results if len(runs) > 1 else first.dataset),
        )
    yield Exhibit(
        "derating",
        "Derating curve",
        "Factor on the request against string temperature: the table in use, and the PI law for three pairs "
        "of gains on a steady rise of temperature.",
        partial(charts.derating_curves, first.system),
    )


def details(run: Run) -> Iterator[Exhibit]:
    """Figures of one run."""
    data = run.dataset
    if "price_eur_mwh" in data:
        yield Exhibit(
            "market",
            "Market",
            "Price, dispatch and mean state of charge.",
            partial(charts.market_dispatch, data),
        )
    daily = TimeAxis(data).daily
    yield Exhibit(
        "strings",
        "State of the strings",
        "State of charge and temperature: daily mean of every string, daily range over all of them in grey."
        if daily
        else "State of charge and mean temperature of every string, demand behind.",
        partial(charts.strings, data),
    )
    yield Exhibit(
        "power",
        "Where the power went",
        "Requested: what was delivered, and what was lost to derating and to availability (discharge "
        "upwards, charge downwards). Loss: in inverters and batteries." + (" Daily means." if daily else ""),
        partial(charts.power_split, data),
    )
    yield Exhibit(
        "inverters",
        "Inverters on and off",
        "Which inverter ran when.",
        partial(figures.inverter_pattern, data),
    )
    if "node_temperature_c" in data:
        yield Exhibit(
            "nodes",
            "Temperature along the air path",
            "Temperature of every node over time, for each string.",
            partial(figures.node_temperatures, data),
        )
    if np.isfinite(data["solver_gap"].values).any() or (data["solver_nodes"].values > 0).any():
        yield Exhibit(
            "solver",
            "Effort of the optimiser",
            "Rigorous gap: to a bound on the nonlinear control model. Search gap: of the convexified "
            "program, on which the search stops. Gaps below 0.0001 % stand at the lower edge.",
            partial(charts.solver_effort, data, run.solve_time_s),
        )
