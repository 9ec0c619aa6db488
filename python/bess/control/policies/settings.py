"""Settings of a policy: section ``[policy]`` of a study, and values from its other sections."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal, Self

from pydantic import model_validator

from bess.control.policies.simplified import Model
from bess.control.split.settings import SplitSettings
from bess.system.quantities import within
from bess.system.sections import Control
from bess.system.terms import SettlementTerms

DEFAULT_FORESIGHT_H = 30.0
"""A day, the longest period of most demands, and six hours: the end of a plan hardly matters at its start."""


class PolicySection(SplitSettings):
    """Section ``[policy]`` of a study: policy, objectives of ``mpc`` and its stopping criteria.

    In ``mode`` ``"plan"``, objectives of kind ``energy`` (the default) and ``money`` (the default in studies
    with prices) are planned over ``foresight_h``, 30 hours by default, with ``rollouts`` for the effort of
    each step (:class:`bess.control.planning.Planner`). In ``mode`` ``"certified"``, the next
    ``horizon_steps`` are split with a certificate: ``gap``, ``node_limit`` and ``time_limit_s`` are settings
    of :class:`bess.PowerSplit`. A study without a mode plans, unless its other keys are those of a certified
    split (``horizon_steps``, ``foresight_h = 0``, objectives of kind ``paper``). ``model`` is the plant model
    of ``mpc``: nonlinear, with convex losses, or linear with one efficiency
    (:func:`bess.control.policies.simplified.simplified`). ``file`` is the ``policy.json`` of the policy
    ``distilled``; other policies do not read it.
    """

    name: str = "mpc"
    mode: Literal["plan", "certified"] | None = None
    file: str | None = None
    foresight_h: Annotated[float, within(0.0, 48.0, "h")] | None = None
    rollouts: Annotated[int, within(0, 1_000_000)] | None = None
    model: Model = "nonlinear"
    horizon_steps: Annotated[int, within(1, 96)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        of_plan = f"foresight_h = {self.foresight_h:g} h" if self.foresight_h else None
        of_split = {
            'objectives.kind = "paper" (it has priorities)': self.objectives.kind == "paper",
            f"horizon_steps = {self.horizon_steps}": self.horizon_steps is not None,
            "foresight_h = 0": self.foresight_h == 0.0,
        }
        against = next((key for key, given in of_split.items() if given), None)
        if self.plans and against:
            raise ValueError(
                f"{against} is for a certified split, {of_plan or 'mode = plan'} for a plan: use only one of "
                'them, or mode = "certified"'
            )
        if not self.plans and of_plan:
            raise ValueError(f'{of_plan} is for a plan, mode = "certified" looks horizon_steps ahead')
        if not self.plans and self.objectives.kind == "money":
            raise ValueError(
                'objectives.kind = "money" is planned: leave out horizon_steps and foresight_h = 0, and use '
                'mode = "plan"; a certified split needs objectives.kind = "energy" or "paper"'
            )
        return self

    @property
    def plans(self) -> bool:
        """Whether ``mpc`` plans; otherwise it computes a certified split."""
        if self.mode is not None:
            return self.mode == "plan"
        if self.foresight_h is None:
            return self.objectives.kind != "paper" and self.horizon_steps is None
        return self.foresight_h > 0.0

    def steps_ahead(self, control: Control) -> int:
        """Return the prediction horizon in control steps."""
        if self.plans:
            hours = DEFAULT_FORESIGHT_H if self.foresight_h is None else self.foresight_h
            return max(1, round(hours * 60.0 / control.step_min))
        return self.horizon_steps or control.horizon_steps


@dataclass(frozen=True)
class Settings:
    """Settings of a policy; a rule needs the control step only.

    Attributes
    ----------
    dt_h : float
        Control step [h].
    horizon_steps : int
        Prediction horizon [steps].
    policy : PolicySection
        Section ``[policy]``.
    terms : SettlementTerms
        Fees and penalties in addition to the market price.
    reactive : bool
        Whether the study has a reactive power demand.
    """

    dt_h: float = 0.25
    horizon_steps: int = 8
    policy: PolicySection = field(default_factory=PolicySection)
    terms: SettlementTerms = field(default_factory=SettlementTerms)
    reactive: bool = False
