"""What a study says about its policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Settings:
    """Settings of a policy; a rule needs the control step only.

    Attributes
    ----------
    dt_h : float
        Control step [h].
    horizon_steps : int
        Steps a policy is told of.
    objectives : mapping
        Keywords of :class:`bess.Objectives`: a weight, or keywords of
        :class:`bess.split.objectives.Objective`.
    gap : float
        Relative gap at which a search stops.
    node_limit : int
        Most nodes of each stage of a search. In closed loop one suffices: with 1, 4 and 30 the KPIs of a
        week of case 1 were the same, for what further nodes raise is the bound, not the split.
    time_limit_s : float or None
        Longest time of a search; answers then depend on the machine.
    """

    dt_h: float = 0.25
    horizon_steps: int = 8
    objectives: Mapping[str, Any] = field(default_factory=dict)
    gap: float = 1e-3
    node_limit: int = 1
    time_limit_s: float | None = None
