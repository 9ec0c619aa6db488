"""Policy of a controller from ``bess distil``: no solver, no search, a few microseconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bess.checkpoints import Checkpointed
from bess.control.explicit import ExplicitController, Tables
from bess.control.policies.policy import NO_OPTIMISATION, Decision, PolicyInput
from bess.control.policies.reactive import refuse_reactive
from bess.control.policies.settings import Settings
from bess.errors import InputError
from bess.system import System


class DistilledPolicy(Checkpointed):
    """Evaluates one :class:`bess.control.explicit.ExplicitController` in every step with demand.

    Attributes
    ----------
    controller : ExplicitController
        Controller of the policy.
    """

    statuses: Mapping[int, str] = {NO_OPTIMISATION: "no optimisation needed"}

    def __init__(self, controller: ExplicitController) -> None:
        self.controller = controller

    def __call__(self, inputs: PolicyInput) -> Decision:
        """Allocate the demand of this step."""
        if inputs.demand_kw[0] == 0.0:
            return Decision(np.zeros_like(inputs.limit_kw))
        return Decision(self.controller.split(inputs.state, inputs.demand_kw, inputs.limit_kw))


def build(system: System, settings: Settings) -> DistilledPolicy:
    """Return the controller of ``policy.file``, which must have been distilled for this plant."""
    refuse_reactive('policy.name = "distilled"', "use mpc or a rule", requested=settings.reactive)
    file = settings.policy.file
    if file is None:
        raise InputError(
            'policy.name = "distilled" needs policy.file, the policy.json that bess distil writes'
        )
    controller = ExplicitController.read(file)
    tables = controller.tables
    given = f"policy.file = {file}: distilled for"
    if tables.step_h != settings.dt_h:
        raise InputError(f"{given} steps of {tables.step_h:g} h, this study has steps of {settings.dt_h:g} h")
    if tables.steps != settings.horizon_steps:
        raise InputError(
            f"{given} a forecast of {tables.steps * tables.step_h:g} h, this study has a forecast of "
            f"{settings.horizon_steps * settings.dt_h:g} h; set policy.foresight_h, or distil this study"
        )
    own = Tables.of(system, tables.steps, tables.step_h, tables.shortfall)
    if own.strings != tables.strings:
        raise InputError(f"{given} {tables.strings} strings, this plant has {own.strings}")
    differing = [name for name, value in own if not _equal(value, getattr(tables, name))]
    if differing:
        raise InputError(
            f"{given} another plant (of system {controller.system!r}; {', '.join(differing)} differ); "
            "distil this study"
        )
    return DistilledPolicy(controller)


def _equal(one: Any, other: Any) -> bool:
    """Whether two tables are equal; versions of the core may round the last digit differently."""
    return np.shape(one) == np.shape(other) and np.allclose(one, other, 1e-12, 0.0)
