"""Numbers that the documentation quotes: measured here, stored in ``_cases/numbers.json``, shown from there.

``make cases`` measures all of them. ``tests/docs/test_numbers.py`` measures again what takes seconds, and
holds the stored numbers and every table and phrase made of them to it.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from tables import markdown_table

import bess
from bess.report.charts.kpi_figures import EFFICIENCIES
from bess.report.words.paper import comparisons, reading
from bess.simulation.analysis.catalogue import grouped, kpi

DOCS = Path(__file__).parent
TABLES = DOCS / "_cases"
STORED = TABLES / "numbers.json"
WORDS = TABLES / "words.json"
M5BAT_DATA = DOCS.parents[1] / "shared" / "data"
"""Measured day of M5BAT, beside the checkout; without it the stored numbers of that page stay."""

CASES = (
    "delivered_kwh",
    "undelivered_kwh",
    "lost_kwh",
    *EFFICIENCIES,
    "peak_mean_temperature_c",
    "peak_string_temperature_c",
    "soc_spread_max",
    "inverter_starts_mean",
    "fallback_steps",
    "solver_gap_median",
    "solver_search_gap_median",
)
DIFFERING = (
    "availability_pct",
    "derating_efficiency_pct",
    "system_efficiency_pct",
    "delivered_kwh",
    "lost_kwh",
    "soc_spread_start",
    "soc_spread_end",
    "temperature_spread_start_k",
    "temperature_spread_end_k",
)
REACTIVE = (
    "delivered_kwh",
    "undelivered_kwh",
    "reactive_demand_kvarh",
    "reactive_kvarh",
    "inverter_efficiency_pct",
    "battery_efficiency_pct",
    "lost_kwh",
    "inverter_starts_mean",
)
CONSTANT_RESISTANCE = {
    "system.parameters.battery.resistance_temperature": {"temperature_c": [25.0], "resistance_mohm": [2.5]}
}
M5BAT_POLICIES = ("equal", "priority", "mpc")

Figures = dict[str, dict[str, float]]
"""Key figures of each run of a study."""
Runs = Mapping[str, bess.Result]


def study(name: str) -> bess.Study:
    """One of the studies of the pages."""
    return {
        "case1": lambda: bess.load_study("policies"),
        "case2": lambda: bess.load_study("case2"),
        "constant-resistance": lambda: bess.load_study("case2", CONSTANT_RESISTANCE),
        "differing": lambda: bess.load_study("differing"),
        "reactive": lambda: bess.load_study("reactive"),
        "differing-tight": lambda: bess.load_study("differing", {"demand.scale": 1.5}),
    }[name]()


def runs(name: str, folder: Path) -> Runs:
    """Run one of the studies of the pages."""
    return bess.run_scenarios(study(name), out=folder / name, resume=True, progress=False)


STUDIES = ("case1", "case2", "constant-resistance", "differing", "differing-tight", "reactive")


def figures_of(results: Runs) -> Figures:
    """Key figures that pages show, to seven digits."""
    wanted = {*CASES, *DIFFERING, *REACTIVE}
    return {
        name: {key: _rounded(value) for key, value in result.kpis.items() if key in wanted}
        for name, result in results.items()
    }


def m5bat(
    data: Path = M5BAT_DATA,
    policies: Sequence[str] = M5BAT_POLICIES,
    replay: Callable[[str, Any], Any] | None = None,
) -> dict[str, Any] | None:
    """What the example makes of the measured day; None where the data are not at hand.

    ``replay`` gives the run of a policy in place of the example's function of this name.
    """
    import pandas as pd

    if not (data / "bess" / "m5bat_2023-04-07_15min.parquet").exists():
        return None
    example = _example("m5bat")
    second = pd.read_parquet(data / "bess/m5bat_bess_battery_together_sample.parquet")
    day = pd.read_parquet(data / "bess/m5bat_2023-04-07_15min.parquet")
    demand_kw = day.M5BAT_P.to_numpy(dtype=np.float64)
    replays = {name: (replay or example.replay)(name, demand_kw) for name in policies}
    samples = pd.read_parquet(data / "inverter/m5bat_inverter_steady_samples.parquet")
    readings = example.loss_readings(samples, second)
    losses = {
        str(row): {key: _rounded(float(v)) for key, v in values.dropna().items()}
        for row, values in readings.iterrows()
    }
    carried = float((samples.q_kvar.abs() > example.CARRIES_KVAR).mean())
    units = example.units_by_power(second, demand_kw, replays).drop(columns=["seconds"])
    made = example.policy_table(demand_kw, replays).drop(index=["seconds"])
    return {
        "throughput_kwh": _rounded(float(np.abs(demand_kw).sum()) * example.DT_H),
        "policies": {name: {key: float(v) for key, v in made[name].items()} for name in policies},
        "losses": losses,
        "with_reactive_pct": _rounded(100.0 * carried),
        "units": {str(row): {key: float(v) for key, v in values.items()} for row, values in units.iterrows()},
    }


def stored() -> dict[str, Any]:
    """Numbers as the pages show them."""
    numbers: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    return numbers


def tables(numbers: Mapping[str, Any]) -> dict[str, str]:
    """Text of every file in ``_cases`` that is made of the numbers."""
    rows = comparisons(numbers["case2"])
    paper = [["", "the paper", "here", "reproduced"]]
    paper += [[row.statement, row.paper, row.here, str(row.verdict)] for row in rows]
    made = {
        "case2-paper.md": markdown_table(paper) + "\n" + "\n\n".join(reading(rows)) + "\n",
        "case2-kpis.md": _kpi_table(numbers["case2"], CASES),
        "policies.md": _kpi_table(numbers["case1"], CASES),
        "differing.md": _differing_table(numbers["differing"]),
        "differing-tight.md": _differing_table(numbers["differing-tight"]),
        "reactive.md": _kpi_table(numbers["reactive"], REACTIVE),
        "m5bat-units.md": _units_table(numbers["m5bat"]["units"]),
        "m5bat-losses.md": _losses_table(numbers["m5bat"]["losses"]),
        "m5bat-policies.md": _m5bat_table(numbers["m5bat"]),
    }
    marked = {name: f"<!-- written by make cases -->\n\n{text}" for name, text in made.items()}
    return marked | {WORDS.name: json.dumps(words(numbers), indent=1, sort_keys=True) + "\n"}


def words(numbers: Mapping[str, Any]) -> dict[str, str]:
    """Numbers within sentences, by the name under which a page asks for them."""
    constant = numbers["constant-resistance"]
    day = numbers["m5bat"]
    policies, throughput = day["policies"], day["throughput_kwh"]
    return {
        "constant_resistance_s1_pct": f"{constant['S1']['derating_efficiency_pct']:.1f}",
        "constant_resistance_s2_pct": f"{constant['S2']['derating_efficiency_pct']:.1f}",
        "reactive_saved_pct": f"{_saved_pct(numbers['reactive']):.0f}",
        "m5bat_with_reactive_pct": f"{day['with_reactive_pct']:.0f}",
        "m5bat_active_no_load_kw": f"{day['losses']['line over active power']['no load, kW']:.1f}",
        "m5bat_apparent_no_load_kw": f"{day['losses']['line over apparent power']['no load, kW']:.1f}",
        "m5bat_active_error_kw": f"{-day['losses']['line over active power']['mean error with Q, kW']:.1f}",
        "m5bat_equal_inverter_pct": f"{100.0 * policies['equal']['inverter loss, kWh'] / throughput:.1f}",
        "m5bat_priority_undelivered_kwh": f"{policies['priority']['not delivered, kWh']:.0f}",
        "m5bat_priority_derated_kwh": f"{policies['priority']['of that by derating, kWh']:.0f}",
        "m5bat_mpc_lost_pct": f"{policies['mpc']['both, % of throughput']:.1f}",
        "m5bat_mpc_undelivered_kwh": f"{policies['mpc']['not delivered, kWh']:.0f}",
        "m5bat_mpc_most_units": f"{policies['mpc']['units running, most']:.0f}",
        "m5bat_mpc_largest_share_pct": f"{policies['mpc']['largest share of one unit, %']:.0f}",
    }


def _kpi_table(kpis: Mapping[str, Mapping[str, float]], keys: Sequence[str]) -> str:
    table = [["", *kpis]]
    table += [
        [kpi(key).heading, *(kpi(key).number(k.get(key, math.nan)) for k in kpis.values())]
        for key in chain.from_iterable(grouped(keys).values())
        if any(key in k for k in kpis.values())
    ]
    return markdown_table(table)


def _differing_table(kpis: Mapping[str, Mapping[str, float]]) -> str:
    plain = [key for key in DIFFERING if "spread" not in key]
    rows = [["", *kpis]]
    rows += [[kpi(key).heading, *(kpi(key).number(k[key]) for k in kpis.values())] for key in plain]
    for label, name, factor, digits in (
        ("SOC spread, start to end [points]", "soc_spread_{}", 100.0, 0),
        ("temperature spread, start to end [K]", "temperature_spread_{}_k", 1.0, 1),
    ):
        ends = [(k[name.format("start")] * factor, k[name.format("end")] * factor) for k in kpis.values()]
        rows.append([label, *(f"{start:.{digits}f} → {end:.{digits}f}" for start, end in ends)])
    return markdown_table(rows)


def _units_table(units: Mapping[str, Mapping[str, float]]) -> str:
    names = [key.removesuffix(", units") for key in next(iter(units.values())) if key.endswith(", units")]
    rows = [["plant power [kW]", "real: 1 / share of unit 10", *names]]
    for label, values in units.items():
        low, high = (int(float(edge)) for edge in label.strip("(]").split(","))
        real = values["real units, 1 / share of unit 10"]
        if low < 0 or math.isnan(real):
            continue
        counts = [values[f"{name}, units"] for name in names]
        shown = ("–" if math.isnan(v) else f"{v:.1f}" for v in (real, *counts))
        rows.append([f"{low} to {high}", *shown])
    return markdown_table(rows)


def _saved_pct(runs: Mapping[str, Mapping[str, float]]) -> float:
    """By how much ``mpc`` loses less than the best rule."""
    best = min(run["lost_kwh"] for name, run in runs.items() if name != "mpc")
    return 100.0 * (1.0 - runs["mpc"]["lost_kwh"] / best)


def _losses_table(losses: Mapping[str, Mapping[str, float]]) -> str:
    names = ("line over active power", "line over apparent power", "measured")
    rows = [["", *names]]
    for label, key, digits in (
        ("loss at no load [kW]", "no load, kW", 2),
        ("slope [%]", "slope, %", 2),
        ("mean error, seconds without reactive power [kW]", "mean error without Q, kW", 2),
        ("mean error, seconds with [kW]", "mean error with Q, kW", 2),
        ("mean absolute error, without [kW]", "mean absolute error without Q, kW", 2),
        ("mean absolute error, with [kW]", "mean absolute error with Q, kW", 2),
        ("unit 1 over the day [kWh]", "batt1, kWh", 1),
        ("unit 10 over the day [kWh]", "batt10, kWh", 1),
    ):
        shown = (f"{losses[name][key]:.{digits}f}" if key in losses[name] else " " for name in names)
        rows.append([label, *shown])
    return markdown_table(rows)


def _m5bat_table(day: Mapping[str, Any]) -> str:
    policies = day["policies"]
    rows = [["", *policies]]
    for label, key, digits in (
        ("units running, mean", "units running, mean", 1),
        ("units running, most", "units running, most", 0),
        ("unit 1 runs, share of time (measured 0.22)", "unit 1 running, share", 2),
        ("unit 10 runs, share of time (measured 0.45)", "unit 10 running, share", 2),
        ("starts of all units (measured: unit 1 253, unit 10 131)", "starts of all units", 0),
        ("inverter loss [kWh]", "inverter loss, kWh", 0),
        ("battery loss [kWh]", "battery loss, kWh", 0),
        ("both, share of throughput [%]", "both, % of throughput", 1),
        ("not delivered [kWh]", "not delivered, kWh", 0),
    ):
        rows.append([label, *(f"{values[key]:.{digits}f}" for values in policies.values())])
    return markdown_table(rows)


def _rounded(value: float) -> float:
    return float(f"{value:.7g}")


def _example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS.parent / "examples" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    import sys

    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses of the example look themselves up there
    spec.loader.exec_module(module)
    return module
