"""Runs that cannot be compared by their key figures: another plant, demand, length, price or version."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from bess.report.runs import Run
from bess.simulation.record.provenance import leaves

_CHOICES: Final = frozenset(
    ("name", "title", "policy", "output", "service", "scenario", "sweep", "system", "run", "wear")
)
"""Sections of a study that say how a plant is controlled and what is kept, or that are compared below."""
_CHOICES_OF_DEMAND: Final = frozenset(
    ("plan", "replan_h", "look_ahead_h", "forecast", "forecast_prices", "efficiency", "cycles_per_day",
     "cycles_per_plan", "end_price_eur_mwh", "max_power_kw", "max_energy_kwh", "capacity_kw", "band",
     "recharge_kw", "recharge_slot_min", "recharge_lead_min", "limit_kw", "ready_soc")
)  # fmt: skip
"""Keys of ``[demand]`` that say how a dispatch plans."""
_MOST: Final = 6


def unlike(runs: Mapping[str, Run]) -> str:
    """Return in which circumstances runs differ, as a sentence; empty if only their control does."""
    found = _differing([_circumstances(run) for run in runs.values()])
    return found and f"These runs are unlike, so none of them is marked best: {found}."


def choices(runs: Mapping[str, Run]) -> str:
    """Return in which choices of control runs differ, as a sentence; empty if in none."""
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
    """Keys whose values are not the same in all runs, with the values as they are shown."""
    found = []
    for key in dict.fromkeys(key for each in of_each for key in each):
        values = dict(each.get(key, ("", "not set")) for each in of_each)
        if len(values) > 1:
            shown = list(dict.fromkeys(values.values()))
            listed = "; ".join([*shown[:_MOST], *(["..."] if len(shown) > _MOST else [])])
            found.append(f"{key} ({listed})" if len(shown) > 1 else f"{key} ({listed}, not the same)")
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return f"{', '.join(found[:_MOST])}{more}"


def _circumstances(run: Run) -> dict[str, tuple[str, str]]:
    """What a run was given: what tells it from another's, and how it is shown."""
    frame, system = run.identity["frame"], run.system
    steps = frame["n_steps"] if run.finished else run.dataset.sizes["time"]
    kw, kwh = system.nominal_kw.sum(), system.nominal_energy_kwh.sum()
    # All numbers of the plant but for what its wear is worth.
    plant = {key: value for key, value in run.identity["system"].items() if key not in ("about", "wear")}
    shown = {
        "length": f"{steps * frame['step_s'] / 3600.0:g} h",
        "control step": f"{frame['step_s'] / 60.0:g} min",
        "start": f"{datetime.fromtimestamp(frame['start_s'], tz=UTC):%Y-%m-%d %H:%M} UTC",
        **dict(_given(run)),
        "version": str(run.identity["version"]),
    }
    files = run.identity.get("files", {})
    return {
        "system": (str(sorted(leaves(plant))), f"{system.n_strings} strings, {kw:.4g} kW, {kwh:.4g} kWh"),
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
