"""Summary of a report: subject, results, events, differences of strings and of runs, and warnings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from bess.control.policies.planned import PLANNED
from bess.control.policies.settings import DEFAULT_FORESIGHT_H
from bess.display import amount, rounded
from bess.errors import by_reason
from bess.report.contents import MAX_COMPARED_RUNS
from bess.report.data import events_of, operation_of, step_h
from bess.report.runs import Run
from bess.simulation.analysis.catalogue import kpi, serving_most
from bess.simulation.analysis.services import unprovable
from bess.simulation.analysis.settlement import COSTS, REVENUES
from bess.simulation.record.provenance import leaves

T = TypeVar("T")

_LEDGER_TOLERANCE_KWH = 1e-6
_LEDGER_TOLERANCE = 1e-9
_MIN_MENTIONED_KWH = 0.05


def subject(runs: Mapping[str, Run], *, alike: bool = True) -> str:
    """Return the policies of runs and, if the runs are comparable, strings, length and start."""
    first = next(iter(runs.values()))
    data = first.dataset
    hours = data.sizes["time"] * step_h(data)
    length = f"{hours:g} h" if hours < 24 * 14 else f"{hours / 24:.4g} days"
    n_strings = data.sizes["string"]
    start = np.datetime_as_string(data["time"].values[0], unit="m").replace("T", " ")
    policies = dict.fromkeys(run.policy for run in runs.values())
    count = [f"{len(runs)} scenarios"] if len(runs) > 1 else []
    where = [f"{n_strings} string{'s' if n_strings > 1 else ''}", f"{length} from {start} UTC"]
    policy = f"polic{'ies' if len(policies) > 1 else 'y'} {', '.join(filter(None, policies))}"
    return " · ".join([*count, *(where if alike else []), policy])


def summary(runs: Mapping[str, Run], *, hindsight: bool = False) -> list[str]:
    """Sentences on the results; with ``hindsight``, the page shows it beside them."""
    first = next(iter(runs.values()))
    events = [*event_sentences(runs), *spread_sentences(runs)]
    if len(runs) == 1:
        said = [*_one_run(first), *events, *_gap_sentence(first), *_short_horizon(first)]
    else:
        said = [*_alike(runs), *([] if unlike(runs) else _compared(runs)), *events]
    return [*said, *_plan_sentences(runs, hindsight=hindsight)]


def gain_sentence(run: Run) -> str:
    """Undelivered energy and losses of the run, and the difference to the best rule on the same demand."""
    kpis = run.kpis
    lost = f"{run.policy}: {_kwh(kpis['lost_kwh'])} undelivered or lost"
    if kpis["unmet_kwh"] >= _MIN_MENTIONED_KWH:
        lost += f" besides {_kwh(kpis['unmet_kwh'])} of demand above the power in service"
    if not run.gain_rule:
        return f"{lost}."
    said = f"{lost}{_against_rule(run)}"
    if abs(stored := kpis.get("gain_stored_kwh", 0.0)) >= _MIN_MENTIONED_KWH:
        said += f"; {_kwh(abs(stored))} {'more' if stored > 0.0 else 'less'} stored at the end"
    if (gain := kpis.get("gain_eur")) is None:
        return f"{said}."
    number = kpi("gain_eur").number
    more = "more" if gain > 0.0 else "less"
    earned = "as much as" if number(gain) == number(0.0) else f"{number(abs(gain))} EUR {more} than"
    return (
        f"{said}. Its net income is {number(kpis['net_eur'])} EUR, {earned} that of the best rule on the "
        "same demand."
    )


def _against_rule(run: Run) -> str:
    gain = run.kpis["gain_kwh"]
    of_rule = run.kpis["lost_kwh"] + gain
    share = f" ({100.0 * abs(gain) / of_rule:.0f} %)" if of_rule > 0.0 else ""
    if run.gain_rule == run.policy:
        return ", the best rule for this demand"
    if abs(gain) < _MIN_MENTIONED_KWH:
        return f", as much as the best rule, {run.gain_rule}"
    return (
        f", {_kwh(abs(gain))}{share} {'less' if gain > 0.0 else 'more'} than the best rule, {run.gain_rule}"
    )


def _one_run(run: Run) -> Iterator[str]:
    kpis, data = run.kpis, run.dataset
    demand_kw, delivered_kw = data["demand_kw"].values, data["delivered_kw"].values.sum(axis=1)
    for name, asks in (("Charged", demand_kw < 0.0), ("Discharged", demand_kw > 0.0)):
        given, asked = (abs(float(kw[asks].sum())) * step_h(data) for kw in (delivered_kw, demand_kw))
        if asked > 0.0:
            yield f"{name}: {_kwh(given)} of {_kwh(asked)} demand, {100.0 * given / asked:.1f} %."
    if "net_eur" in kpis:
        earned = [*_entries_eur(kpis, REVENUES, 1.0), *_entries_eur(kpis, COSTS, -1.0)]
        spent = [*_entries_eur(kpis, COSTS, 1.0), *_entries_eur(kpis, REVENUES, -1.0)]
        yield (
            f"Net income: {amount(kpis['net_eur'])} EUR, from {' and '.join(earned) or 'no revenue'} "
            f"less {', '.join(spent) or 'no costs'}."
        )


def _entries_eur(kpis: Mapping[str, float], names: Iterable[str], sign: float) -> list[str]:
    """The entries of a ledger with this sign that are not zero, each with its name."""
    return [
        f"{'' if sign > 0.0 else 'negative '}{kpi(name).label[0].lower()}{kpi(name).label[1:]} "
        f"{amount(sign * kpis[name])} EUR"
        for name in names
        if sign * kpis.get(name, 0.0) >= 0.05
    ]


def _compared(runs: Mapping[str, Run]) -> Iterator[str]:
    kpis = {name: run.kpis for name, run in runs.items()}
    served = serving_most(kpis)
    if len(served) < len(runs):
        unmet = [f"{name} {_kwh(kpis[name]['unmet_kwh'])}" for name in kpis if name not in served]
        yield f"More demand than in other scenarios is above the power in service: {', '.join(unmet)}."
    lost = {name: row["lost_kwh"] for name, row in served.items()}
    best = min(lost, key=lambda name: lost[name])
    share_pct = 100.0 * lost[best] / max(runs[best].kpis["demand_kwh"], 1e-9)
    if len({kpi("lost_kwh").number(value) for value in lost.values()}) == 1:
        others = "other " * (len(lost) < len(runs))
        yield f"Undelivered + losses: {_kwh(lost[best])} in every {others}scenario."
    else:
        firsts = [name for name, value in lost.items() if _kwh(value) == _kwh(lost[best])]
        yield (
            f"Lowest undelivered + losses: {_listed(firsts)}, {_kwh(lost[best])} "
            f"({share_pct:.1f} % of the demand)."
        )
    if all("net_eur" in run.kpis for run in runs.values()):
        net = {name: run.kpis["net_eur"] for name, run in runs.items()}
        first = max(net, key=lambda name: net[name])
        yield f"Highest net income: {first}, {kpi('net_eur').quantity(net[first])}."


def _alike(runs: Mapping[str, Run]) -> Iterator[str]:
    """Runs in which the plant did the same, to the last bit."""
    for names in _names_by(runs, lambda run: [operation_of(run.dataset)]).values():
        if len(names) > 1:
            yield f"{_listed(names)} are identical in every step."


def _gap_sentence(run: Run) -> Iterator[str]:
    """Gap of the certified splits, in per cent and in kWh: the gap of each step times its lost energy."""
    data = run.dataset
    gap = data["solver_gap"].values
    known = np.isfinite(gap) & (data["solver_status"].values != PLANNED)
    if not known.any():
        return
    lost_kw = sum(
        data[name].values.sum(axis=1)
        for name in ("availability_loss_kw", "derating_loss_kw", "inverter_loss_kw", "battery_loss_kw")
    )
    worth = float((np.clip(gap, 0.0, 1.0) * lost_kw)[known].sum()) * step_h(data)
    middle, worst, count = 100.0 * np.median(gap[known]), 100.0 * gap[known].max(), int(known.sum())
    yield (
        f"Rigorous gap of the splits: {rounded(middle)} % (median), {rounded(worst)} % (worst of "
        f"{count:,} step{'s' * (count > 1)}), or {_kwh(worth)} of the undelivered energy and losses in these "
        "steps."
    )


def _short_horizon(run: Run) -> Iterator[str]:
    """Why certified splits can lose more than a rule, and what looks further ahead."""
    if (
        run.policy == "mpc"
        and run.study["policy"].get("mode") == "certified"
        and run.kpis.get("gain_kwh", 0.0) < -_MIN_MENTIONED_KWH
    ):
        yield (
            "Certified splits see no heat and charge beyond their short horizon, so a rule can lose less. "
            'Plans look a day ahead: omit policy.mode, and choose policy.objectives.kind = "energy".'
        )


def _plan_sentences(runs: Mapping[str, Run], *, hindsight: bool) -> Iterator[str]:
    """Runs that follow plans, and the gaps of these plans; a sentence for each prediction horizon."""
    planned: dict[tuple[float, bool], list[str]] = {}
    for name, run in runs.items():
        if (run.dataset["solver_status"].values == PLANNED).any():
            hours = run.study.get("policy", {}).get("foresight_h", DEFAULT_FORESIGHT_H)
            planned.setdefault((float(hours), unprovable(run.dataset, run.system) is None), []).append(name)
    for (hours, provable), names in planned.items():
        who = f"{_listed(names)}: every" if len(runs) > 1 else "Every"
        yield (
            f"{who} step was planned over {hours:g} h."
            + "".join(f" {_plan_gap(runs[name], f' of {name}' * (len(runs) > 1))}" for name in names)
            + " bess report --hindsight adds the best known result and a lower bound."
            * (provable and not hindsight)
        )


def _plan_gap(run: Run, of_run: str) -> str:
    """Optimality gap of the plans of a run."""
    bounds = {"plan_search_gap_pct": "the estimated lower bound", "plan_gap_pct": "the rigorous one"}
    found = {bound: run.kpis[name] for name, bound in bounds.items() if name in run.kpis}
    gaps = [f"within {rounded(gap)} % of {bound}" for bound, gap in found.items()]
    if not gaps:
        return f"No plan{of_run} has a bound."
    return f"Plans{of_run} are {' and '.join(gaps)} (medians of the plans with a bound)."


def _names_by(runs: Mapping[str, Run], properties: Callable[[Run], Iterable[T]]) -> dict[T, list[str]]:
    """Names of the runs that have each property."""
    names: dict[T, list[str]] = {}
    for name, run in runs.items():
        for each in properties(run):
            names.setdefault(each, []).append(name)
    return names


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _kwh(value: float) -> str:
    return f"{amount(value)} kWh"


def warnings(runs: Mapping[str, Run], problems: Mapping[str, str]) -> list[str]:
    """Warnings on the validity of the results, a sentence each, with a remedy."""
    found = [f"Missing: {sentence}" for sentence in by_reason(problems)]
    if len(runs) > MAX_COMPARED_RUNS:
        return found + list(_warnings_of_many(runs))
    for sentence, named in _names_by(runs, _warnings_of).items():
        place = f"{_listed(named)}: {sentence}" if len(runs) > 1 else ""
        found.append(place or f"{sentence[0].upper()}{sentence[1:]}")
    return found


def _warnings_of_many(runs: Mapping[str, Run]) -> Iterator[str]:
    """Warnings from KPIs only, without opening the records of hundreds of scenarios."""
    stopped = [name for name, run in runs.items() if not run.finished]
    if stopped:
        yield (
            f"{len(stopped)} of {len(runs)} scenarios stopped early, among them {stopped[0]}; run the sweep "
            "again to continue."
        )
    limits = {
        "fallback_steps": ("steps in which a fallback replaced the optimiser's answer", 0.0),
        "ledger_residual_ratio": ("relative energy-balance error", _LEDGER_TOLERANCE),
    }
    for key, (text, limit) in limits.items():
        values = {name: run.kpis.get(key, 0.0) for name, run in runs.items()}
        if above := {name: value for name, value in values.items() if value > limit}:
            worst, value = max(above.items(), key=lambda entry: entry[1])
            yield f"{len(above)} of {len(runs)} scenarios: {text}; most in {worst}, {value:.4g}."


def _warnings_of(run: Run) -> Iterator[str]:
    data = run.dataset
    steps = data.sizes["time"]
    if not run.finished:
        total = run.identity["frame"]["n_steps"]
        end = np.datetime_as_string(data["time"].values[-1], unit="m").replace("T", " ")
        yield (
            f"stopped early; everything here covers the first {steps:,} of {total:,} steps, up to {end} UTC. "
            "Continue with --resume (from Python: resume=True)."
        )
    fallbacks = int(data["fallback"].sum())
    if fallbacks:
        yield (
            f"in {fallbacks:,} of {steps:,} steps a fallback replaced the optimiser's answer; log.jsonl "
            "names the steps and why."
        )
    residual = float(np.abs(data["ledger_residual_kwh"]).max())
    if residual > _LEDGER_TOLERANCE_KWH:
        yield f"the energy balance does not close: residual of up to {rounded(residual)} kWh in a step."


_MIN_MENTIONED = 0.01
_MAX_INSTALLATIONS = 6


def event_sentences(runs: Mapping[str, Run]) -> Iterator[str]:
    """Which string was out of service or limited, when, and in which runs; new batteries of the first run."""
    for sentence, names in _names_by(runs, _events).items():
        yield sentence if len(names) == len(runs) else f"{_listed(names)}: {sentence}"
    yield from _installations(next(iter(runs.values())))


def _events(run: Run) -> Iterator[str]:
    """Events up to the end of the record, in order of their start."""
    end_of_record = run.dataset["time"].values[-1].astype("datetime64[s]").item().replace(tzinfo=UTC)
    for start, end, effect, event in sorted(events_of(run.study), key=lambda one: one[:2]):
        if start <= end_of_record:
            known = ", as announced" if event.get("announced") and run.policy == "mpc" else ""
            yield (
                f"String {event['string']} was {effect} from {start:%Y-%m-%d %H:%M} to "
                f"{end:%Y-%m-%d %H:%M} UTC{known}."
            )


def _installations(run: Run) -> Iterator[str]:
    """New batteries, with date and cost, and the capacity that they replaced, if any."""
    data = run.dataset
    if "investment_eur" not in data:
        return
    places = np.argwhere(data["investment_eur"].values > 0.0)
    added = {table["string"] for table in run.study.get("augmentation", ())}
    for step, string in places[:_MAX_INSTALLATIONS]:
        day, eur = str(data["time"].values[step])[:10], data["investment_eur"].values[step, string]
        if string in added:
            added.remove(string)
            yield f"String {string} was added on {day} for {eur:,.0f} EUR."
            continue
        before, after = data["soh_capacity"].values[step - 1 : step + 1, string]
        yield (
            f"String {string} got a new battery on {day} for {eur:,.0f} EUR; its capacity rose "
            f"from {100.0 * before:.1f} to {100.0 * after:.1f} % of nominal."
        )
    if len(places) > _MAX_INSTALLATIONS:
        yield f"{len(places) - _MAX_INSTALLATIONS} more batteries were installed."


def spread_sentences(runs: Mapping[str, Run]) -> Iterator[str]:
    """SOC differences of the strings at the start, and at the end under each policy."""
    starts = [run.kpis.get("soc_spread_start", 0.0) for run in runs.values()]
    if max(starts) < _MIN_MENTIONED:
        return
    ends = (
        f"{f'{name} ' * (len(runs) > 1)}{100.0 * start:.1f} to {100.0 * run.kpis['soc_spread_end']:.1f}"
        for (name, run), start in zip(runs.items(), starts, strict=True)
    )
    yield f"Largest minus smallest SOC of the strings, from start to end in points: {', '.join(ends)}."


_CHOICES: Final = frozenset(
    ("name", "title", "policy", "output", "service", "scenario", "sweep", "system", "run", "wear")
)
"""Sections of a study on control and output, and sections that are compared below."""
_CHOICES_OF_DEMAND: Final = frozenset(
    ("plan", "replan_h", "look_ahead_h", "forecast", "forecast_prices", "efficiency", "cycles_per_day",
     "cycles_per_plan", "end_price_eur_mwh", "max_power_kw", "max_energy_kwh", "capacity_kw", "band",
     "recharge_kw", "recharge_slot_min", "recharge_lead_min", "limit_kw", "ready_soc")
)  # fmt: skip
"""Keys of ``[demand]`` with the settings of dispatch planning."""
_MAX_KEYS: Final = 6


def unlike(runs: Mapping[str, Run]) -> str:
    """Return a sentence on the circumstances in which runs differ; empty if only their control differs."""
    found = _differing([_circumstances(run) for run in runs.values()])
    return found and f"These runs are unlike, so none of them is marked best: {found}."


def choices(runs: Mapping[str, Run]) -> str:
    """Return a sentence on the control settings in which runs differ; empty without differences."""
    found = _differing(
        [
            {key: (value, value.strip('"')) for key, value in leaves(run.study)
             if key.partition(".")[0] not in ("name", "title", "output", "scenario", "sweep")
             and value != "null"}
            for run in runs.values()
        ]
    )  # fmt: skip
    return found and f"These runs differ in {found}."


def _differing(of_each: list[dict[str, tuple[str, str]]]) -> str:
    """Keys whose values differ between runs, with the values as shown."""
    found = []
    for key in dict.fromkeys(key for each in of_each for key in each):
        values = dict(each.get(key, ("", "not set")) for each in of_each)
        if len(values) > 1:
            shown = list(dict.fromkeys(values.values()))
            listed = "; ".join([*shown[:_MAX_KEYS], *(["..."] if len(shown) > _MAX_KEYS else [])])
            found.append(f"{key} ({listed})" if len(shown) > 1 else f"{key} ({listed}, not the same)")
    more = f" and {len(found) - _MAX_KEYS} more" if len(found) > _MAX_KEYS else ""
    return f"{', '.join(found[:_MAX_KEYS])}{more}"


def _circumstances(run: Run) -> dict[str, tuple[str, str]]:
    """Circumstances of a run: by name, a value to compare and the text to show."""
    frame, system = run.identity["frame"], run.system
    steps = frame["n_steps"] if run.finished else run.dataset.sizes["time"]
    kw, kwh = system.nominal_kw.sum(), system.nominal_energy_kwh.sum()
    # All parameters of the plant except the cost of wear.
    plant = {key: value for key, value in run.identity["system"].items() if key not in ("about", "wear")}
    shown = {
        "length": f"{steps * frame['step_s'] / 3600.0:g} h",
        "control step": f"{frame['step_s'] / 60.0:g} min",
        "start": f"{datetime.fromtimestamp(frame['start_s'], tz=UTC):%Y-%m-%d %H:%M} UTC",
        **dict(_given(run)),
        "version": str(run.identity["version"]),
    }
    files = run.identity.get("files", {})
    size = f"{system.n_strings} strings, {rounded(kw, 4)} kW, {rounded(kwh, 4)} kWh"
    return {
        "system": (str(sorted(leaves(plant))), size),
        **{key: (files.get(value, value), Path(value).name if value in files else value)
           for key, value in shown.items()},
    }  # fmt: skip


def _given(run: Run) -> Iterator[tuple[str, str]]:
    """Keys of the study beside its choices, and their values."""
    sections = {key: value for key, value in run.study.items() if key not in _CHOICES}
    law = {"run.derating_law": run.study.get("run", {}).get("derating_law")}
    wear = {"wear": run.identity["system"].get("wear", {})}
    for key, value in [*leaves(sections | wear), *leaves(law)]:
        if key.removeprefix("demand.") not in _CHOICES_OF_DEMAND and value != "null":
            yield key, value.strip('"')
