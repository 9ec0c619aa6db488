"""Policy settings of a study, for runs and for the service."""

from __future__ import annotations

from bess.control.policies import Settings
from bess.study.study import Study
from bess.system import System


def policy_settings(study: Study, system: System) -> Settings:
    """Return the settings of the study's policy for its system."""
    choice = study.policy
    return Settings(
        dt_h=system.control.step_min / 60.0,
        horizon_steps=choice.steps_ahead(system.control),
        split=choice,
        plans=choice.plans,
        rollouts=choice.rollouts,
        model=choice.model,
        terms=study.settlement.terms,
        file=choice.file,
        reactive=study.reactive is not None,
    )
