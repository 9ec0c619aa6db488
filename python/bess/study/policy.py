"""Section ``[policy]`` of a study file: which policy, and whether it plans or certifies."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bess.foresight.planner import ROLLOUTS
from bess.parameters.quantities import within
from bess.parameters.sections import Control
from bess.split.settings import SplitSettings

DEFAULT_FORESIGHT_H = 24.0
"""A day: the longest rhythm of most demands, and a little more than the time constant of a warm string."""


class PolicyChoice(SplitSettings):
    """Section ``[policy]``: which policy, and what ``mpc`` minimises and when it stops searching.

    Objectives of kind ``energy`` (the default) and ``money`` (the default in studies with prices) are planned
    over ``foresight_h``, 24 hours by default, with ``rollouts`` for the effort of each step
    (:class:`bess.foresight.Planner`). With ``foresight_h = 0``, and for objectives of kind ``paper``, the
    next ``horizon_steps`` are split with a certificate: ``gap``, ``node_limit`` and ``time_limit_s`` are
    settings of :class:`bess.PowerSplit`. ``model`` is what ``mpc`` takes the plant for: as it is, with convex
    losses, or with one efficiency (:func:`bess.policies.simplified.simplified`). ``file`` is the
    ``policy.json`` of the policy ``distilled``; other policies do not read it.
    """

    name: str = "mpc"
    file: str | None = None
    foresight_h: Annotated[float, within(0.0, 48.0, "h")] | None = None
    rollouts: Annotated[int, Field(ge=0, le=1_000_000)] = ROLLOUTS
    model: Literal["nonlinear", "convex", "linear"] = "nonlinear"
    horizon_steps: Annotated[int, Field(ge=1, le=96)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.foresight_h and self.objectives.kind == "paper":
            raise ValueError(
                f'foresight_h = {self.foresight_h:g} h: objectives of kind "paper" have priorities and are '
                'split within horizon_steps; use kind "energy" or "money", or foresight_h = 0'
            )
        if self.foresight_h and self.horizon_steps is not None:
            raise ValueError(
                f"foresight_h = {self.foresight_h:g} h and horizon_steps = {self.horizon_steps}: the first "
                "is for a plan, the second for a certified split; give one of them"
            )
        if self.objectives.kind == "money" and not self.plans:
            raise ValueError(
                'objectives.kind = "money" is planned: leave out horizon_steps and foresight_h = 0'
            )
        return self

    @property
    def plans(self) -> bool:
        """Whether ``mpc`` plans with foresight; else it splits a horizon with a certificate."""
        if self.foresight_h is None:
            return self.objectives.kind != "paper" and self.horizon_steps is None
        return self.foresight_h > 0.0

    def steps_ahead(self, control: Control) -> int:
        """Control steps that a policy is told of."""
        if self.plans:
            hours = DEFAULT_FORESIGHT_H if self.foresight_h is None else self.foresight_h
            return max(1, round(hours * 60.0 / control.step_min))
        return self.horizon_steps or control.horizon_steps
