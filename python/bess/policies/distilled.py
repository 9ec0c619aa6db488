"""The controller that ``bess distil`` made: no solver, no search, a few microseconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bess.errors import InputError
from bess.explicit import ExplicitController, Tables
from bess.parameters import System
from bess.policies.policy import NO_OPTIMISATION, Decision, Situation
from bess.policies.reactive import refuse_reactive
from bess.policies.settings import Settings


class DistilledPolicy:
    """Asks one :class:`bess.explicit.ExplicitController` in every step in which something is asked.

    Attributes
    ----------
    controller : ExplicitController
        What decides.
    """

    statuses: Mapping[int, str] = {NO_OPTIMISATION: "no optimisation needed"}

    def __init__(self, controller: ExplicitController) -> None:
        self.controller = controller

    def __call__(self, situation: Situation) -> Decision:
        """Share the demand of this step."""
        if situation.demand_kw[0] == 0.0:
            return Decision(np.zeros_like(situation.limit_kw))
        return Decision(self.controller.split(situation.state, situation.demand_kw, situation.limit_kw))

    def memory(self) -> dict[str, Any]:
        """Nothing: it looks at the situation only."""
        return {}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Nothing to restore."""


def build(system: System, settings: Settings) -> DistilledPolicy:
    """Return the controller of ``settings.file``, which must have been distilled for this plant.

    Raises
    ------
    InputError
        No file is named, it is not what ``bess distil`` writes, or it is for another plant, control step or
        foresight.
    """
    refuse_reactive('policy.name = "distilled"', "use mpc or a rule", asked=settings.reactive)
    if settings.file is None:
        raise InputError(
            'policy.name = "distilled" needs policy.file, the policy.json that bess distil writes'
        )
    controller = ExplicitController.read(settings.file)
    tables = controller.tables
    given = f"policy.file = {settings.file}: was distilled for"
    if tables.step_h != settings.dt_h:
        raise InputError(f"{given} steps of {tables.step_h:g} h, this study has steps of {settings.dt_h:g} h")
    if tables.steps != settings.horizon_steps:
        raise InputError(
            f"{given} a controller that is told {tables.steps * tables.step_h:g} h ahead, this study tells "
            f"{settings.horizon_steps * settings.dt_h:g} h; set policy.foresight_h, or distil this study"
        )
    own = Tables.of(system, tables.steps, tables.step_h, tables.shortfall)
    if own.strings != tables.strings:
        raise InputError(f"{given} {tables.strings} strings, this plant has {own.strings}")
    if own != tables:
        differing = [name for name in type(own).model_fields if getattr(own, name) != getattr(tables, name)]
        raise InputError(
            f"{given} another plant (of system {controller.system!r}; {', '.join(differing)} differ); "
            "distil this study"
        )
    return DistilledPolicy(controller)
