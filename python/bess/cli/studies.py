"""Studies for commands: checks without a run, and the list of bundled items."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from bess._core import ageing_models
from bess.control.planning.groups import MIN_GROUPS
from bess.control.planning.planner import BOUND_STEPS, rollouts_of
from bess.control.policies import POLICIES, plug_ins
from bess.display import rounded
from bess.errors import InputError, placed
from bess.simulation.inputs import Inputs, prepare
from bess.simulation.runner import closed_loop
from bess.study import Study, bundled_studies, expand, load_study
from bess.system.components.registry import Entry, list_cells, list_inverters, list_systems

_PAPER: Final = (
    'note: policy.objectives.kind = "paper" selects the normalised objectives of the paper; in 12 of 28 '
    "measured scenarios they cost more energy than a rule; omit the key, except to reproduce the paper"
)


_START_S: Final = 1.5
_PLANT_S: Final = 0.25e-6
"""A step of the plant, for each string."""
_ROLLOUT_S: Final = 0.13e-6
"""A step of a string in a plan, for each roll-out."""
_RESTARTS: Final = 1.25
"""Work of all calls over that of calls without a restart."""
_SHARED_S: Final = 4.5e-6
"""A step of a string in a plan of groups: rules, and shares of the power of its group."""
_BOUND_S: Final = 0.1
"""A bound of a plan, for each string or group."""
_SPLIT_S: Final = 1e-3
"""A step of a string in a certified split that stops at its root."""


def findings(study: Study) -> Iterator[str]:
    """Yield the facts of each run of a study, line by line; raise InputError for the first problem."""
    runs = expand(study)
    seen = None
    for name, each in runs.items():
        with placed(name if len(runs) > 1 else ""):
            inputs = prepare(each)
            closed_loop(each, inputs)
        facts = [
            f"system: {inputs.system}",
            *inputs.notes,
            f"ambient: {inputs.ambient_c.min():g} to {inputs.ambient_c.max():g} degC",
            *_events(each),
            _policy(each, inputs),
            f"time: about {rounded(_seconds(each, inputs))} CPU s, an estimate without dispatch and files",
            *([_PAPER] if each.policy.name == "mpc" and each.policy.objectives.kind == "paper" else []),
        ]
        yield name if facts != seen else f"{name}: same data"
        if facts != seen:
            yield from (f"  {fact}" for fact in facts)
        seen = facts
    yield f"{study.name}: {len(runs)} run{'s' if len(runs) > 1 else ''}, no problems found"


def _events(study: Study) -> Iterator[str]:
    """Describe the events of the study, and say where an announcement has no effect."""
    if study.event:
        announced = sum(event.announced for event in study.event)
        unused = ", which has no effect: only mpc plans ahead" * bool(
            announced and study.policy.name != "mpc"
        )
        yield f"events: {len(study.event)}, of which {announced} announced{unused}"


def _policy(study: Study, inputs: Inputs) -> str:
    """Return the policy and, for ``mpc``, its prediction horizon."""
    if study.policy.name != "mpc":
        return f"policy: {study.policy.name}"
    reach = f"over {inputs.horizon_steps * inputs.grid.dt_h:g} h"
    how = f"planned {reach}, not certified" if study.policy.plans else f"certified {reach}"
    return f"policy: mpc, {how}"


def _seconds(study: Study, inputs: Inputs) -> float:
    """CPU time of a run [s], fitted to measured runs of 1 to 1,000 reference strings on one core."""
    control, grid = inputs.system.control, inputs.grid
    n_strings, ahead = inputs.system.n_strings, inputs.horizon_steps
    each_step = _PLANT_S * n_strings * grid.step_s / control.plant_step_s
    bounds = 0.0
    if study.policy.name == "mpc" and study.policy.plans:
        planned = min(n_strings, MIN_GROUPS)
        rollouts = rollouts_of(n_strings, study.policy.rollouts)
        each_step += _RESTARTS * rollouts * planned * ahead * _ROLLOUT_S
        if n_strings > MIN_GROUPS:
            each_step += n_strings * ahead * _SHARED_S
        bounds = _BOUND_S * planned * -(-grid.n_steps // BOUND_STEPS)
    elif study.policy.name == "mpc":
        each_step += n_strings * ahead * _SPLIT_S
    return _START_S + grid.n_steps * each_step + bounds


def listing(words: Sequence[str] = ()) -> str:
    """Return bundled entries by kind; systems, cells and inverters with source and licence.

    The first of ``words`` may be a kind (:data:`KINDS`, or its singular). The name or text of each entry
    contains every other word, ignoring case; InputError if there is no such entry.
    """
    kind = next((kind for kind in KINDS if words and kind.startswith(_stem(words[0]))), None)
    wanted = [word.casefold() for word in (words if kind is None else words[1:])]
    found: dict[str, dict[str, str]] = {}
    for name, make in KINDS.items():
        if kind in (None, name):
            things = make().items()
            chosen = {k: v for k, v in things if all(word in f"{k} {v}".casefold() for word in wanted)}
            found |= {name: chosen} if chosen else {}
    if not found:
        raise InputError(
            f"bess list {' '.join(words)}: no entry contains {' and '.join(map(repr, wanted))}; omit words, "
            f"or start with a kind: {', '.join(KINDS)}"
        )
    width = max(len(name) for entries in found.values() for name in entries)
    indent = "\n" + " " * (width + 4)
    blocks = []
    for kind, entries in found.items():
        lines = (f"  {name.ljust(width)}  {text}".replace("\n", indent) for name, text in entries.items())
        blocks.append("\n".join([kind, *lines]))
    return "\n\n".join(blocks)


def _stem(word: str) -> str:
    """Return a kind without its plural ending; very short words stay as they are."""
    stem = word.casefold().removesuffix("s").removesuffix("ie").removesuffix("y")
    return stem if len(stem) > 2 else word


def _wear_models() -> dict[str, str]:
    priced = {
        "none": "no ageing",
        "throughput": "a price per MWh discharged (wear.eur_per_mwh), without capacity loss",
    }
    return priced | dict(ageing_models())


def _with_needs(name: str, title: str) -> str:
    """Return the title of a study with its required inputs."""
    demand = load_study(name).demand
    needs_prices = demand.kind == "arbitrage" and demand.prices is None
    return f"{title}; needs --set demand.prices=FILE" if needs_prices else title


def _sourced(entry: Entry) -> str:
    return f"{entry.description}\nsource: {entry.source}\nlicence: {entry.licence}"


KINDS: Final[Mapping[str, Callable[[], dict[str, str]]]] = {
    "studies": lambda: {name: _with_needs(name, title) for name, title in bundled_studies().items()},
    "systems": lambda: {entry.name: _sourced(entry) for entry in list_systems()},
    "cells": lambda: {entry.name: _sourced(entry) for entry in list_cells()},
    "inverters": lambda: {entry.name: _sourced(entry) for entry in list_inverters()},
    "wear models": _wear_models,
    "policies": lambda: (
        {name: description for name, (_, description) in POLICIES.items()}
        | {name: f"plug-in {point.value}" for name, point in sorted(plug_ins().items())}
    ),
}
"""Contents of ``bess list`` by kind: texts by name."""
