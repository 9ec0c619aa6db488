"""Pareto fronts of ``howto/weights.md``: ``python docs/make_fronts.py FOLDER``, two minutes of CPU.

101 weights of inverter against battery losses over the paper's 48 h, and 101 prices of wear over a bundled
week of market prices; each set runs on local workers, and FOLDER keeps what is finished.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tables import markdown_table, save_picture

import bess
from bess.dispatch.synthetic import market_prices
from bess.report import figures
from bess.simulation.analysis import pareto
from bess.simulation.analysis.catalogue import better, kpi

DOCS = Path(__file__).parent
STORED = DOCS / "_cases" / "fronts.json"
WORKERS = 2
POINTS = 101
WEIGHTS = ("inverter_efficiency_pct", "battery_efficiency_pct")
WEAR = ("wear_eur", "revenue_eur")
WEIGHTS_SHOWN = (
    *WEIGHTS,
    "system_efficiency_pct",
    "derating_efficiency_pct",
    "availability_pct",
    "peak_mean_temperature_c",
    "lost_kwh",
)
WEAR_SHOWN = (*WEAR, "net_eur", "full_cycles", "peak_mean_temperature_c")
DAYS = 7.0
WEIGHTS_STUDY = f"""
title = "Weights of inverter against battery losses"
[demand]
file = "two-cycle-48h"
repeat = true
[policy]
name = "mpc"
objectives.kind = "paper"
[[sweep]]
simplex = ["policy.objectives.inverter", "policy.objectives.battery"]
divisions = {POINTS - 1}
"""
WEAR_STUDY = f"""
title = "Money against wear: the price of wear that a dispatch plans with"
[system]
initial_soh_capacity = 0.92
[demand]
kind = "arbitrage"
prices = "prices.csv"
zone = "EUR/MWh"
[wear]
model = "nmc-a-75ah"
calendar_share = 0.3
[policy]
name = "equal"
[run]
days = {DAYS}
[[sweep]]
key = "wear.eur_per_mwh"
start = 0.0
stop = 200.0
count = {POINTS}
"""

Figures = dict[str, dict[str, float]]
Front = dict[str, Any]


def main(folder: Path) -> None:
    """Run, store and write."""
    stored = {
        "weights": figures_of(weights(folder), WEIGHTS_SHOWN),
        "wear": figures_of(wear(folder), WEAR_SHOWN),
    }
    STORED.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    for name, text in tables(read()).items():
        (DOCS / "_cases" / name).write_text(text, encoding="utf-8")
    for name, axes in (("weights", WEIGHTS), ("wear", WEAR)):
        save_picture(figures.pareto_front(read()[name], x=axes[0], y=axes[1]), f"front-{name}")


def weights(folder: Path) -> pd.DataFrame:
    """Runs over the weights."""
    return _sweep(folder, "weights", WEIGHTS_STUDY)


def wear(folder: Path) -> pd.DataFrame:
    """Runs over the price of wear, at the bundled week of prices twice."""
    folder.mkdir(parents=True, exist_ok=True)
    prices = np.tile(market_prices(), 2)
    times = pd.date_range("2024-01-01", periods=prices.size, freq="h", tz="UTC", name="time")
    pd.Series(prices, times, name="EUR/MWh").to_csv(folder / "prices.csv")
    return _sweep(folder, "wear", WEAR_STUDY)


def _sweep(folder: Path, name: str, text: str) -> pd.DataFrame:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    sweep = bess.run_sweep(path, folder / name, workers=WORKERS)
    if sweep.failed:
        run, reason = next(iter(sweep.failed.items()))
        raise SystemExit(f"{len(sweep.failed)} runs failed, such as {run}: {reason}")
    return sweep.table()


def figures_of(table: pd.DataFrame, shown: tuple[str, ...]) -> Figures:
    """Key figures of each run, to seven digits, by the value that was swept first."""
    values = [float(name.partition("=")[2].partition("_")[0]) for name in table["name"]]
    rows = sorted(zip(values, table.to_dict("records"), strict=True), key=lambda pair: pair[0])
    return {f"{value:g}": {key: float(f"{row[key]:.7g}") for key in shown} for value, row in rows}


def read() -> dict[str, Figures]:
    """Numbers as the page shows them."""
    numbers: dict[str, Figures] = json.loads(STORED.read_text(encoding="utf-8"))
    return numbers


def front_of(runs: Mapping[str, Mapping[str, float]], axes: tuple[str, str]) -> Front:
    """Which runs are on the front, its knee, and the share of the box between its ends that it dominates."""
    names = list(runs)
    points = np.array([[runs[name][axis] for axis in axes] for name in names])
    directions = [better(axis) for axis in axes]
    on_front = pareto.non_dominated(points, directions)
    signs = np.array([1.0 if direction == "min" else -1.0 for direction in directions])
    front = points[on_front] * signs
    box = float(np.prod(np.ptp(front, axis=0)))
    worst = front.max(axis=0) * signs
    volume = pareto.hypervolume(points, worst, directions)
    return {
        "names": names,
        "on_front": [name for name, on in zip(names, on_front, strict=True) if on],
        "knee": names[pareto.knee_point(points, directions)],
        "hypervolume": volume,
        "share": volume / box if box > 0.0 else 1.0,
    }


def tables(numbers: Mapping[str, Figures]) -> dict[str, str]:
    """Text of every file that is made of the numbers."""
    made = {
        "front-weights.md": preferences(
            numbers["weights"], WEIGHTS, WEIGHTS_SHOWN, _WEIGHT_WISHES, _weights_of
        ),
        "front-wear.md": preferences(numbers["wear"], WEAR, WEAR_SHOWN, _WEAR_WISHES, _price_of),
    }
    return {name: f"<!-- written by docs/make_fronts.py -->\n\n{text}" for name, text in made.items()}


_WEIGHT_WISHES = {
    "highest inverter efficiency": "inverter_efficiency_pct",
    "highest battery efficiency": "battery_efficiency_pct",
    "highest system efficiency": "system_efficiency_pct",
    "least lost, undelivered energy included": "lost_kwh",
    "coolest": "peak_mean_temperature_c",
    "least curtailed by derating": "derating_efficiency_pct",
    "most available": "availability_pct",
}
_WEAR_WISHES = {
    "most revenue, whatever wears": "revenue_eur",
    "least wear": "wear_eur",
    "most left after wear": "net_eur",
}


def _weights_of(name: str) -> str:
    return f"{float(name):.2f} / {1.0 - float(name):.2f}"


def _price_of(name: str) -> str:
    return f"{float(name):.0f}"


def preferences(
    runs: Mapping[str, Mapping[str, float]],
    axes: tuple[str, str],
    shown: tuple[str, ...],
    wishes: Mapping[str, str],
    label: Any,
) -> str:
    """For each preference the setting to take and what comes of it, then the front in a sentence."""
    front = front_of(runs, axes)
    rows = [["preference", "setting", *(kpi(key).heading for key in shown)]]
    chosen = {wish: _best(runs, key) for wish, key in wishes.items()}
    chosen["a balance of both: the knee"] = front["knee"]
    for wish, name in chosen.items():
        rows.append([wish, label(name), *(kpi(key).number(runs[name][key]) for key in shown)])
    units = " ".join(kpi(axis).unit for axis in axes)
    sentence = (
        f"{len(front['names'])} settings, {len(front['on_front'])} of them on the front; knee at "
        f"{label(front['knee'])}; hypervolume {front['hypervolume']:.4g} ({units}), which is "
        f"{100.0 * front['share']:.0f} % of the box between the ends of the front."
    )
    return f"{markdown_table(rows)}\n{sentence}\n"


def _best(runs: Mapping[str, Mapping[str, float]], key: str) -> str:
    sign = 1.0 if better(key) == "max" else -1.0
    return max(runs, key=lambda name: sign * runs[name][key])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
