"""What a report says in words: the summary, and what a reader has to be warned of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from bess.analysis.catalogue import kpi
from bess.report.contents import MOST_COMPARED
from bess.report.data import step_h
from bess.report.differing import event_sentences, spread_sentences
from bess.report.runs import Run

_LEDGER_TOLERANCE_KWH = 1e-6
_LEDGER_TOLERANCE = 1e-9


def summary(runs: Mapping[str, Run]) -> list[str]:
    """Sentences on what ran and what came out."""
    first = next(iter(runs.values()))
    data = first.dataset
    hours = data.sizes["time"] * step_h(data)
    length = f"{hours:g} h" if hours < 24 * 14 else f"{hours / 24:.4g} days"
    n_strings = data.sizes["string"]
    start = np.datetime_as_string(data["time"].values[0], unit="m").replace("T", " ")
    plural = "s" if n_strings > 1 else ""
    steps = f"{data.sizes['time']:,} steps"
    what = f"{n_strings} string{plural} over {length} ({steps}), from {start} UTC"
    if len(runs) == 1:
        return [f"{what}. {_one(first)}", *event_sentences(first), *spread_sentences(runs)]
    judged = ("system_efficiency_pct", "availability_pct", "peak_mean_temperature_c")
    values = ({name: run.kpis[key] for name, run in runs.items()} for key in judged)
    return [
        f"{len(runs)} scenarios: {what}.",
        *event_sentences(first),
        *map(_best_of, judged, values),
        *_against_equal_split(runs),
        *spread_sentences(runs),
    ]


def _against_equal_split(runs: Mapping[str, Run]) -> Iterator[str]:
    """Every scenario of another policy against the simplest one, if there is one of each."""
    policies = {name: run.study.get("policy", {}).get("name") for name, run in runs.items()}
    baseline = next((name for name, policy in policies.items() if policy == "equal"), None)
    if baseline is None:
        return
    for name, policy in policies.items():
        if policy == "equal":
            continue
        system, availability, derating, peak_k = (
            runs[name].kpis[key] - runs[baseline].kpis[key]
            for key in (
                "system_efficiency_pct",
                "availability_pct",
                "derating_efficiency_pct",
                "peak_mean_temperature_c",
            )
        )
        yield (
            f"{name} against the equal split: system efficiency {system:+.2f} points, availability "
            f"{availability:+.2f} points, derating efficiency {derating:+.2f} points, peak mean temperature "
            f"{peak_k:+.1f} K."
        )


def _one(run: Run) -> str:
    data, kpis = run.dataset, run.kpis
    asked = float(np.abs(data["demand_kw"]).sum()) * step_h(data)
    delivered = float(np.abs(data["delivered_kw"].sum("string")).sum()) * step_h(data)
    revenue = f" Revenue: {kpis['revenue_eur']:,.0f} EUR." if "revenue_eur" in kpis else ""
    return (
        f"{delivered:,.0f} of {asked:,.0f} kWh asked for (charge and discharge) were delivered: availability "
        f"{kpis['availability_pct']:.2f} %, derating efficiency {kpis['derating_efficiency_pct']:.2f} %. "
        f"System efficiency was {kpis['system_efficiency_pct']:.2f} % (inverter "
        f"{kpis['inverter_efficiency_pct']:.2f} %, battery {kpis['battery_efficiency_pct']:.2f} %). The mean "
        f"temperature peaked at {kpis['peak_mean_temperature_c']:.1f} °C, the hottest node reached "
        f"{kpis['peak_node_temperature_c']:.1f} °C.{revenue}"
    )


def _best_of(key: str, values: Mapping[str, float]) -> str:
    name = kpi(key)
    sign = 1.0 if name.better == "max" else -1.0
    rounded = {scenario: round(value, name.decimals or 0) for scenario, value in values.items()}
    best, worst = (sign * extreme(sign * value for value in rounded.values()) for extreme in (max, min))
    shown = f"{best:.{name.decimals}f} {name.unit}"
    if best == worst:
        return f"{name.label} is {shown} in every scenario."
    first = ", ".join(scenario for scenario, value in rounded.items() if value == best)
    last = ", ".join(scenario for scenario, value in rounded.items() if value == worst)
    word = "Highest" if name.better == "max" else "Lowest"
    unit = "points" if name.unit == "%" else "K"
    return (
        f"{word} {name.label[0].lower() + name.label[1:]}: {first} with {shown}, "
        f"{abs(best - worst):.{name.decimals}f} {unit} better than {last}."
    )


def warnings(runs: Mapping[str, Run], problems: Mapping[str, str]) -> list[str]:
    """One sentence for each thing that limits what the numbers mean; of many scenarios, one for each kind."""
    found = [f"{name} is missing: {reason}" for name, reason in problems.items()]
    if len(runs) > MOST_COMPARED:
        return found + list(_warnings_of_many(runs))
    for name, run in runs.items():
        found += [f"{name}: {sentence}" for sentence in _warnings_of(run)]
    return found


def _warnings_of_many(runs: Mapping[str, Run]) -> Iterator[str]:
    """The same from KPIs alone: the records of hundreds of scenarios are not opened for it."""
    stopped = [name for name, run in runs.items() if not run.finished]
    if stopped:
        yield f"{len(stopped)} of {len(runs)} scenarios stopped early, among them {stopped[0]}."
    limits = {
        "fallback_steps": ("steps in which a fallback replaced the optimiser's answer", 0.0),
        "unmet_kwh": ("kWh of demand above the power in service", 0.0),
        "ledger_residual_ratio": ("of the energy missing in the ledger", _LEDGER_TOLERANCE),
    }
    for key, (text, limit) in limits.items():
        worst, count = _worst(runs, {name: run.kpis.get(key, 0.0) - limit for name, run in runs.items()})
        if count:
            most = f"most in {worst}, {runs[worst].kpis[key]:.4g}"
            yield f"{count} of {len(runs)} scenarios: {text}; {most}."
    excess = {
        name: run.kpis.get("solver_search_gap_max", 0.0) - run.study.get("policy", {}).get("gap", np.inf)
        for name, run in runs.items()
    }
    worst, count = _worst(runs, excess)
    if count:
        gap = 100 * runs[worst].kpis["solver_search_gap_max"]
        yield (
            f"{count} of {len(runs)} scenarios: steps in which the search stopped above its target gap; "
            f"worst in {worst}, {gap:.2g} %."
        )


def _worst(runs: Mapping[str, Run], excess: Mapping[str, float]) -> tuple[str, int]:
    """Scenario with the largest excess, and how many have any."""
    return max(runs, key=lambda name: excess[name]), sum(value > 0.0 for value in excess.values())


def _warnings_of(run: Run) -> list[str]:
    data = run.dataset
    steps = data.sizes["time"]
    found = []
    if not run.finished:
        total = run.identity["frame"]["n_steps"]
        end = np.datetime_as_string(data["time"].values[-1], unit="m").replace("T", " ")
        found.append(
            f"stopped early; everything here covers the first {steps:,} of {total:,} steps, up to {end} UTC."
        )
    fallbacks = int(data["fallback"].sum())
    if fallbacks:
        found.append(f"in {fallbacks:,} of {steps:,} steps a fallback replaced the optimiser's answer.")
    unmet = float(data["unmet_kw"].sum()) * step_h(data)
    if unmet > 0.0:
        short = int((data["unmet_kw"] > 0.0).sum())
        found.append(
            f"{unmet:,.1f} kWh of demand in {short:,} of {steps:,} steps exceeded the power in service."
        )
    target = run.study.get("policy", {}).get("gap")
    gap = data["solver_search_gap"].values
    if target is not None and np.any(gap > target):
        above = gap[gap > target]
        found.append(
            f"in {above.size:,} of {steps:,} steps the search stopped above its target gap of "
            f"{100 * target:g} % (worst {100 * above.max():.2g} %)."
        )
    residual = float(np.abs(data["ledger_residual_kwh"]).max())
    if residual > _LEDGER_TOLERANCE_KWH:
        found.append(f"the energy ledger does not close: residual of up to {residual:.2g} kWh in a step.")
    return found
