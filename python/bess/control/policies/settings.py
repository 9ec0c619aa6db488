"""Settings of a policy in a study."""

from __future__ import annotations

from dataclasses import dataclass, field

from bess.control.planning.planner import ROLLOUTS
from bess.control.policies.simplified import Model
from bess.control.split.settings import SplitSettings
from bess.system.terms import SettlementTerms


@dataclass(frozen=True)
class Settings:
    """Settings of a policy; a rule needs the control step only.

    Attributes
    ----------
    dt_h : float
        Control step [h].
    horizon_steps : int
        Prediction horizon [steps].
    split : SplitSettings
        Objectives and stopping criteria.
    plans : bool
        Whether ``mpc`` uses plans (:class:`bess.control.planning.Planner`) instead of certified splits
        (:class:`bess.PowerSplit`).
    rollouts : int
        Effort of a plan.
    model : {"nonlinear", "convex", "linear"}
        Plant model used by ``mpc`` (:func:`bess.control.policies.simplified.simplified`).
    terms : SettlementTerms
        Fees and penalties in addition to the market price.
    file : str or None
        File of a ``distilled`` policy.
    reactive : bool
        Whether the study has a reactive power demand.
    """

    dt_h: float = 0.25
    horizon_steps: int = 8
    split: SplitSettings = field(default_factory=SplitSettings)
    plans: bool = False
    rollouts: int = ROLLOUTS
    model: Model = "nonlinear"
    terms: SettlementTerms = field(default_factory=SettlementTerms)
    file: str | None = None
    reactive: bool = False
