"""Settings of a power split: the one owner of their names, ranges and defaults.

Section ``[policy]`` of a study is made of these, and so are the keywords of :class:`bess.PowerSplit`.
"""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import Field

from bess.parameters.quantities import within
from bess.split.objectives import Choice, Objectives

ROLLOUTS: Final = 2000
"""Effort of one descent of the search on the control model, in roll-outs; nobody has needed to set it."""


class SplitSettings(Choice):
    """What is minimised, and when a search stops.

    Attributes
    ----------
    objectives : Objectives
        Weights, priorities, tolerances, normalisation.
    gap : float
        Relative gap at which a search stops.
    node_limit : int
        Most relaxations solved for each priority. One suffices as a rule: over a week of case 1, limits of 1,
        4 and 30 gave the same KPIs, for what further nodes raise is the bound, not the split.
    time_limit_s : float or None
        Longest wall-clock time of a call; the best split known is then returned and flagged. Answers then
        depend on how fast the machine is, where ``node_limit`` bounds the work repeatably.
    """

    objectives: Objectives = Objectives()
    gap: Annotated[float, Field(strict=True), within(0.0, 1.0, above=True, below=True)] = 1e-3
    node_limit: Annotated[int, Field(strict=True), within(1, 1_000_000_000)] = 1
    time_limit_s: Annotated[float, Field(strict=True), within(0.0, 1e9, "s")] | None = None
