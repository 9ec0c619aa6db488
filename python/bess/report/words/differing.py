"""Sentences on strings that differ: events of the study, and what became of the differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

from bess.report.runs import Run

_WORTH_A_SENTENCE = 0.01


def event_sentences(run: Run) -> Iterator[str]:
    """Which string was out of service or limited, and when."""
    for event in run.study.get("event", ()):
        start, end = (f"{datetime.fromisoformat(str(event[key])):%Y-%m-%d %H:%M}" for key in ("start", "end"))
        limit_kw = event["limit_kw"]
        what = f"limited to {limit_kw:g} kW" if limit_kw > 0.0 else "out of service"
        yield f"String {event['string']} was {what} from {start} to {end} UTC."


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
