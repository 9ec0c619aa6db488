"""Sentences on strings that differ: events of the study, and what became of the differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

import numpy as np

from bess.report.runs import Run

_WORTH_A_SENTENCE = 0.01
_MOST_INSTALLATIONS = 6


def event_sentences(run: Run) -> Iterator[str]:
    """Which string was out of service or limited, and when."""
    for event in run.study.get("event", ()):
        start, end = (f"{datetime.fromisoformat(str(event[key])):%Y-%m-%d %H:%M}" for key in ("start", "end"))
        limit_kw = event["limit_kw"]
        what = f"limited to {limit_kw:g} kW" if limit_kw > 0.0 else "out of service"
        yield f"String {event['string']} was {what} from {start} to {end} UTC."
    yield from _installations(run)


def _installations(run: Run) -> Iterator[str]:
    """New batteries, with date, cost, and the capacity that they replaced."""
    data = run.dataset
    if "investment_eur" not in data:
        return
    places = np.argwhere(data["investment_eur"].values > 0.0)
    for step, string in places[:_MOST_INSTALLATIONS]:
        day, eur = str(data["time"].values[step])[:10], data["investment_eur"].values[step, string]
        before, after = data["soh_capacity"].values[step - 1 : step + 1, string]
        yield (
            f"String {string} got a new battery on {day} for {eur:,.0f} EUR; its capacity rose "
            f"from {100.0 * before:.1f} to {100.0 * after:.1f} % of nominal."
        )
    if len(places) > _MOST_INSTALLATIONS:
        yield f"{len(places) - _MOST_INSTALLATIONS} more batteries were installed."


def spread_sentences(runs: Mapping[str, Run]) -> Iterator[str]:
    """How far the strings' SOCs were apart at the start, and at the end under each policy."""
    starts = [run.kpis.get("soc_spread_start", 0.0) for run in runs.values()]
    if max(starts) < _WORTH_A_SENTENCE:
        return
    ends = (
        f"{name} {100.0 * start:.1f} to {100.0 * run.kpis['soc_spread_end']:.1f}"
        for (name, run), start in zip(runs.items(), starts, strict=True)
    )
    yield f"Largest minus smallest SOC of the strings, from start to end in points: {', '.join(ends)}."
