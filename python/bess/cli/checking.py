"""What ``bess check`` finds out about a study without running it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bess.simulation.inputs import Inputs, prepare
from bess.simulation.runner import closed_loop
from bess.study import Study, expand

_PAPER: Final = (
    'note: policy.objectives.kind = "paper" takes the normalised objectives of the paper, which in energy '
    "cost more than a rule in 13 of 18 scenarios that were measured; leave the key out, unless to reproduce "
    "the paper"
)


def findings(study: Study) -> Iterator[str]:
    """Yield lines for people.

    Raises
    ------
    InputError
        The first thing that is wrong, in any of its runs.
    """
    runs = expand(study)
    seen = None
    for name, each in runs.items():
        inputs = prepare(each)
        closed_loop(each, inputs)
        facts = [
            f"system: {inputs.system}",
            *inputs.notes,
            f"ambient: {inputs.ambient_c.min():g} to {inputs.ambient_c.max():g} degC",
            _policy(each, inputs),
            *([_PAPER] if each.policy.name == "mpc" and each.policy.objectives.kind == "paper" else []),
        ]
        yield name if facts != seen else f"{name}: the same data"
        if facts != seen:
            yield from (f"  {fact}" for fact in facts)
        seen = facts
    yield f"{study.name}: {len(runs)} run{'s' if len(runs) > 1 else ''}, nothing wrong"


def _policy(study: Study, inputs: Inputs) -> str:
    """What decides, and how far ahead it looks; rules do not."""
    if study.policy.name != "mpc":
        return f"policy: {study.policy.name}"
    reach = f"over {inputs.horizon_steps * inputs.grid.dt_h:g} h"
    how = f"planned {reach}, not certified" if study.policy.plans else f"certified {reach}"
    return f"policy: mpc, {how}"
