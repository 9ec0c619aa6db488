"""What a study says about its policy."""

from __future__ import annotations

from dataclasses import dataclass, field

from bess.foresight.planner import ROLLOUTS
from bess.parameters.terms import Terms
from bess.policies.simplified import Model
from bess.split.settings import SplitSettings


@dataclass(frozen=True)
class Settings:
    """Settings of a policy; a rule needs the control step only.

    Attributes
    ----------
    dt_h : float
        Control step [h].
    horizon_steps : int
        Steps a policy is told of.
    split : SplitSettings
        What is minimised, and when a search stops.
    plans : bool
        Whether ``mpc`` plans over those steps (:class:`bess.foresight.Planner`); else it splits them with a
        certificate (:class:`bess.PowerSplit`).
    rollouts : int
        Effort of a plan.
    model : {"nonlinear", "convex", "linear"}
        What ``mpc`` takes the plant for (:func:`bess.policies.simplified.simplified`).
    terms : Terms
        What is agreed on beside the market price.
    file : str or None
        File of a ``distilled`` policy.
    reactive : bool
        Whether reactive power is asked for.
    """

    dt_h: float = 0.25
    horizon_steps: int = 8
    split: SplitSettings = field(default_factory=SplitSettings)
    plans: bool = False
    rollouts: int = ROLLOUTS
    model: Model = "nonlinear"
    terms: Terms = field(default_factory=Terms)
    file: str | None = None
    reactive: bool = False
