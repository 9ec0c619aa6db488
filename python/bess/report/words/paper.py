"""Case 2 and the paper it reproduces: reported and simulated results, and reasons for differences.

Source: Tanjavooru, Pant, Hamacher, Hesse, arXiv:2507.04800, sections "Case 2" and "Discussions".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from bess.report.runs import Run
from bess.simulation.analysis.catalogue import KpisByRun, kpi

_SAME_AVAILABILITY_PCT: Final = 0.05
_WEIGHTS: Final = {"S1": (1.0, 0.0), "S2": (0.5, 0.5), "S3": (0.0, 1.0)}


class Verdict(StrEnum):
    """Whether the simulation confirms a statement of the paper."""

    YES = "yes"
    DIRECTION = "direction only"
    NO = "no"


@dataclass(frozen=True)
class Comparison:
    """One statement of the paper."""

    statement: str
    paper: str
    here: str
    verdict: Verdict


def is_case_2(runs: Mapping[str, Run]) -> bool:
    """Whether these runs are the paper's scenarios S1 to S3: their names and their weights."""
    return set(runs) == set(_WEIGHTS) and all(
        (_weight(run, "inverter"), _weight(run, "battery")) == _WEIGHTS[name] for name, run in runs.items()
    )


def comparisons(kpis: KpisByRun) -> list[Comparison]:
    """Each statement of the paper on S1 to S3, checked against KPIs."""
    highest = [
        _highest(f"{name}_efficiency_pct", f"Highest {name} efficiency", of, of, kpis)
        for name, of in (("inverter", "S1"), ("battery", "S3"), ("derating", "S3"), ("system", "S2"))
    ]
    peak_c = "peak_mean_temperature_c"
    hottest = _highest(peak_c, "Highest peak of the mean temperature", "S1", "S1, 51 °C", kpis)
    peak = {name: entry[peak_c] for name, entry in kpis.items()}
    differences = [
        _difference("Peak of S2 below that of S1", 5.0, "K", peak["S1"] - peak["S2"]),
        _gain("S2 over S1, battery efficiency", 1.0, "battery_efficiency_pct", "S1", kpis),
        _gain("S2 over S3, inverter efficiency", 1.5, "inverter_efficiency_pct", "S3", kpis),
        _gain("S2 over S1, derating efficiency", 2.0, "derating_efficiency_pct", "S1", kpis),
    ]
    availability = {name: entry["availability_pct"] for name, entry in kpis.items()}
    sustained = Comparison(
        "Availability of S2 not below that of S1",
        "“maintaining higher availability”",
        _ranking("availability_pct", availability),
        _verdict(availability["S2"] >= availability["S1"] - _SAME_AVAILABILITY_PCT),
    )
    return [*highest, hottest, *differences, sustained]


def reading(rows: list[Comparison]) -> list[str]:
    """How to read the table, for any outcome."""
    counts = {verdict: [row.statement for row in rows if row.verdict is verdict] for verdict in Verdict}
    verdict = f"{len(counts[Verdict.YES])} of the paper's {len(rows)} statements are reproduced."
    if weak := counts[Verdict.DIRECTION]:
        verdict += f" Only in direction, with less than half of the size: {_listed(weak)}."
    if failed := counts[Verdict.NO]:
        verdict += f" Not reproduced: {_listed(failed)}."
    return [
        verdict,
        "The paper publishes neither its demand nor its cell, inverter and cooling parameters, so "
        "absolute numbers cannot be compared. The reference system was built from published components; "
        "pack size, heat transfer, no-load loss and the level of the 48 h demand were fitted so that S1 "
        "peaks near 51 °C and the inverter gap between S2 and S3 is near 1.5 points. These two are not an "
        "independent confirmation. Not fitted: which scenario has the highest system efficiency, how "
        "much cooler S2 stays than S1, and the gaps in battery and derating efficiency.",
        "Where a gap is smaller than the paper's, the likely reasons are the demand (how much of it "
        "lies where one inverter suffices), the derating law (the table here; the integrating law of "
        "the paper's plant is stricter), and that losses here are those of the plant, while a "
        "relaxation may report others.",
    ]


def _weight(run: Run, objective: str) -> float | None:
    goal = run.study.get("policy", {}).get("objectives", {}).get(objective)
    weight = goal.get("weight") if isinstance(goal, Mapping) else goal
    return None if weight is None else float(weight)


def _highest(key: str, statement: str, expected: str, paper: str, kpis: KpisByRun) -> Comparison:
    values = {name: entry[key] for name, entry in kpis.items()}
    top = max(values, key=lambda name: values[name])
    return Comparison(statement, paper, _ranking(key, values), _verdict(top == expected))


def _gain(statement: str, paper: float, key: str, rival: str, kpis: KpisByRun) -> Comparison:
    return _difference(statement, paper, "points", kpis["S2"][key] - kpis[rival][key])


def _difference(statement: str, paper: float, unit: str, here: float) -> Comparison:
    verdict = Verdict.YES if here >= paper / 2.0 else (Verdict.DIRECTION if here > 0.0 else Verdict.NO)
    said = "about 1 point" if (paper, unit) == (1.0, "points") else f"about {paper:g} {unit}"
    return Comparison(statement, said, f"{here:+.2f} {unit}", verdict)


def _verdict(agrees: bool) -> Verdict:
    return Verdict.YES if agrees else Verdict.NO


def _listed(statements: list[str]) -> str:
    return ", ".join(f"“{statement}”" for statement in statements)


def _ranking(key: str, values: Mapping[str, float]) -> str:
    ranked = sorted(values, key=lambda name: -values[name])
    return ", ".join(f"{name} {kpi(key).quantity(values[name])}".replace(" ", "\u00a0") for name in ranked)
