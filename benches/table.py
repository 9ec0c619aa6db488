"""One table: this package beside its rivals, measured in the same run. How to read it: docs/benchmarks.md.

    python benches/table.py [--days N] [--states N] [--plans N] [--prices FILE] [--out FILE] [--markdown FILE]
    python benches/table.py --only splits growth              some of its parts

Every contender runs in a process of its own; a rival that is not installed is a row that says so.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from contender import Outcome, run_contender
from machine import describe_machine

REPEATS = 3
HORIZONS = (4, 8, 16, 32)
STRINGS = (2, 8, 32)
SPLIT_STEPS = (4, 5)
PARTS = ("plants", "loops", "splits", "growth", "dispatches")
PRICES = Path(__file__).parents[2] / "shared/data/prices/smard_de_viertelstunde_2024_berechnet_resaved.csv"


@dataclass
class Bench:
    """Collects rows for the eye and figures for the file."""

    table: Table
    rows: list[tuple[str, str, str]] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)

    def row(self, name: str, outcome: Outcome, shown: Callable[[Any], tuple[str, str]]) -> None:
        """Add a contender: its figure and what to compare, or why it has none."""
        self.figures[name] = outcome.figures if outcome.figures is not None else {"missing": outcome.reason}
        cells = shown(outcome.figures) if outcome.figures is not None else ("–", outcome.reason)
        self.table.add_row(name, *cells)
        self.rows.append((name, *cells))

    def markdown(self, machine: dict[str, Any]) -> str:
        """The table for the documentation, with where and with what it was measured."""
        head = [("", "measured", "beside"), ("---", "---", "---")]
        lines = ["| " + " | ".join(row) + " |" for row in (*head, *self.rows)]
        versions = ", ".join(f"{name} {number}" for name, number in machine["packages"].items() if number)
        where = f"{machine['cpu']}, {machine['cores']} cores, load {machine['load_before'][0]:.1f} before"
        note = f"Measured {machine['date'][:10]} on {where}; Python {machine['python']}, {versions}."
        return "\n".join(["<!-- written by benches/table.py --markdown -->", "", *lines, "", note, ""])


def plants(bench: Bench, days: float) -> float | None:
    """String-years without control; returns that of SimSES at 10 s."""
    own_days = max(365.0, days)  # so fast that less would measure the clock
    runs = {
        "bess plant, 2 strings, 10 s, 40 nodes": ("bess_plant.py", own_days, 2),
        "bess plant, 8 strings, 10 s, 40 nodes": ("bess_plant.py", own_days, 8),
        "SimSES container, 10 s": ("simses_year.py", days, "container"),
        "SimSES lumped, 15 min": ("simses_year.py", 20 * days, "lumped"),
        "PySAM BatteryStateful, 15 min": ("pysam_year.py", 20 * days, 900),
    }
    done = {name: median_of_runs(*arguments) for name, arguments in runs.items()}
    ours, simses = (done[name].figures for name in (next(iter(runs)), "SimSES container, 10 s"))
    bench.table.add_section()
    for name, outcome in done.items():

        def shown(figures: Any) -> tuple[str, str]:
            cpu_s = figures["string_year_cpu_s"]
            ratio = f"{cpu_s / ours['string_year_cpu_s']:.3g} x the first row" if ours else ""
            return f"{cpu_s:.3g} CPU s / string-year", ratio

        bench.row(name, outcome, shown)
    return simses["string_year_cpu_s"] if simses else None


def loops(bench: Bench, days: float, prices: Path | None, simses_s: float | None) -> None:
    """Years of closed loop, beside two string-years of SimSES without control."""
    bench.table.add_section()
    days = max(91.0, days)  # so that the cost of a run itself, its files and its bound, is a small share

    def shown(figures: Any) -> tuple[str, str]:
        note = f"{figures['solves_per_day']:.0f} solves / day, {figures['peak_memory_mb']:.0f} MB"
        if simses_s is not None:
            note = f"{figures['year_cpu_s'] / (2 * simses_s):.3g} x SimSES 10 s, 2 strings; " + note
        return f"{figures['year_cpu_s']:.0f} CPU s / year", note

    for kind, what in (("planned", "a day planned"), ("certified", "two hours certified")):
        name = f"bess closed loop, {what}, two-cycle profile"
        bench.row(name, run_contender("bess_loop.py", days, kind), shown)
        name = f"bess closed loop, {what}, day-ahead prices"
        if prices is None or not prices.is_file():
            bench.row(name, Outcome(None, f"no price file ({prices}); give --prices"), shown)
        else:
            bench.row(name, run_contender("bess_loop.py", days, kind, prices), shown)


def splits(bench: Bench, states: int, steps: int) -> None:
    """Two strings, a few steps: ours and the rivals on the same states."""
    bench.table.add_section()
    names = ("bess", "gurobi", "bonmin", "scip")
    done = {name: run_contender("splits.py", name, states, steps) for name in names}
    ours = keyed(done["bess"])
    for name, outcome in done.items():
        theirs = keyed(outcome)
        both = [key for key in ours if key in theirs]
        finished = [key for key in both if theirs[key]["finished"]]

        def shown(
            figures: Any, theirs: Any = theirs, both: Any = both, finished: Any = finished, name: str = name
        ) -> tuple[str, str]:
            closed = f"{len(finished)} of {len(figures)} to the gap"
            if not both:
                return "–", closed
            median_ms = f"{1e3 * np.median([theirs[key]['seconds'] for key in both]):.3g} ms"
            if name == "bess":
                return median_ms, f"{closed} (states times weightings)"
            ratio = [theirs[key]["seconds"] / ours[key]["seconds"] for key in both]
            worse = [ours[key]["objective"] / theirs[key]["objective"] - 1.0 for key in both]
            summary = {
                "geometric_mean_ratio": float(np.exp(np.mean(np.log(ratio)))),
                "min_ratio": float(min(ratio)),
                "our_objective_worse_by_at_most": float(max(worse)),
                "our_objective_better_by_at_most": float(-min(worse)),
                "to_the_gap": len(finished),
                "stopped_at_the_time_limit": len(both) - len(finished),
                "without_a_split": len(figures) - len(both),
            }
            bench.figures[f"{name} against bess, {steps} steps"] = summary
            # A time limit is a lower bound of the time that the solver would have taken.
            stopped = summary["stopped_at_the_time_limit"]
            closed += f", {stopped} stopped at the time limit with a split" if stopped else ""
            least = "at least " if stopped else ""
            return median_ms, (
                f"{least}{summary['geometric_mean_ratio']:.0f} x (geometric mean; least {min(ratio):.0f}); "
                f"our objective {100 * min(worse):+.4f} to {100 * max(worse):+.4f} %; {closed}"
            )

        bench.row(f"split, 2 strings x {steps} steps: {name}", outcome, shown)


def growth(bench: Bench, states: int) -> None:
    """Time of a split over strings and over steps."""
    bench.table.add_section()
    sizes = [(2, steps) for steps in HORIZONS] + [(strings, 8) for strings in STRINGS if strings != 2]
    for strings, steps in sizes:
        outcome = run_contender("bess_growth.py", strings, steps, states)
        bench.row(
            f"bess split, {strings} strings x {steps} steps",
            outcome,
            lambda figures: (
                f"{1e3 * figures['median_s']:.3g} ms",
                f"{figures['median_nodes']:.0f} nodes, gap {100 * figures['median_search_gap']:.2g} % "
                f"(rigorous {100 * figures['median_gap']:.2g} %), worst {1e3 * figures['worst_s']:.3g} ms",
            ),
        )


def dispatches(bench: Bench, plans: int) -> None:
    """Plans over 12 hours at steps of 15 min and of a minute: ours, and the published nonlinear program."""
    bench.table.add_section()
    for minutes in (15, 1):
        what = f"dispatch, 12 h, steps of {minutes} min"
        ours = run_contender("bess_dispatch.py", plans, minutes)

        def shown(figures: Any, ours: Any = ours.figures) -> tuple[str, str]:
            beside = f"{figures['earned_eur'] / plans:.3f} EUR a plan in the plant"
            if "solved" in figures:
                ratio = figures["plan_cpu_s"] / ours["plan_cpu_s"]
                beside = f"{ratio:.0f} x the CPU; {beside}; {figures['solved']} of {plans} solved"
            return f"{1e3 * figures['plan_cpu_s']:.3g} ms CPU / plan", beside

        bench.row(f"{what}: bess", ours, shown)
        theirs = run_contender("bonmin_dispatch.py", plans, minutes)
        figures = theirs.figures[0] if isinstance(theirs.figures, list) else theirs.figures
        bench.row(f"{what}: Bonmin", Outcome(figures, theirs.reason), shown)


def median_of_runs(script: str, *arguments: object) -> Outcome:
    """The run with the median CPU time of three."""
    runs = [run_contender(script, *arguments) for _ in range(REPEATS)]
    if any(run.figures is None for run in runs):
        return next(run for run in runs if run.figures is None)
    return sorted(runs, key=lambda run: run.figures["string_year_cpu_s"])[REPEATS // 2]


def keyed(outcome: Outcome) -> dict[tuple[str, int], Any]:
    """Results by weights and seed, those with an answer."""
    entries = outcome.figures or []
    return {(entry["weights"], entry["seed"]): entry for entry in entries if "seconds" in entry}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--days", type=float, default=7.0, help="simulated days (loops: 91 at least)")
    parser.add_argument("--states", type=int, default=5, help="seeded states of each split")
    parser.add_argument("--plans", type=int, default=5, help="plans of each dispatch")
    parser.add_argument("--prices", type=Path, default=PRICES, help="price file for the closed loop")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("results.json"))
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts of the table")
    parser.add_argument("--markdown", type=Path, help="write the table for the documentation as well")
    chosen = parser.parse_args()
    if chosen.markdown is not None and set(chosen.only) != set(PARTS):
        parser.error("--markdown: the table of the documentation is that of one run of all parts")
    machine = describe_machine()
    title = f"{machine['cpu']}, {machine['cores']} cores, {machine['date']}"
    bench = Bench(Table("", "measured", "beside", title=title, title_justify="left"))
    simses_s = plants(bench, chosen.days) if "plants" in chosen.only else None
    if "loops" in chosen.only:
        loops(bench, chosen.days, chosen.prices, simses_s)
    for steps in SPLIT_STEPS if "splits" in chosen.only else ():
        splits(bench, chosen.states, steps)
    if "growth" in chosen.only:
        growth(bench, chosen.states)
    if "dispatches" in chosen.only:
        dispatches(bench, chosen.plans)
    console = Console()
    # Into a file or a pipe, a table as wide as it needs.
    (console if console.is_terminal else Console(width=140)).print(bench.table)
    settings = {"days": chosen.days, "states": chosen.states, "plans": chosen.plans}
    text = json.dumps({"machine": machine, "settings": settings, "figures": bench.figures}, indent=1)
    chosen.out.write_text(text + "\n", encoding="utf-8")
    if chosen.markdown is not None:
        chosen.markdown.write_text(bench.markdown(machine), encoding="utf-8")
    print(f"All figures are in {chosen.out}.")


if __name__ == "__main__":
    main()
