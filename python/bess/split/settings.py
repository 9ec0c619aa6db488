"""Settings of a power split: the one owner of their names, ranges and defaults.

Section ``[policy]`` of a study is made of these, and so are the keywords of :class:`bess.PowerSplit`.
"""

from __future__ import annotations

import sys
from typing import Annotated, Final

from pydantic import Field

from bess.parameters.quantities import within
from bess.split.objectives import Choice, Objectives

ROLLOUTS: Final = 2000
"""Effort of one descent of the search on the control model, in roll-outs; nobody has needed to set it."""

STEPS_OF_STRINGS: Final = 2400
"""Steps of single strings in all nodes that are solved for one priority by default: half a second."""

LARGE: Final = 16
"""Steps of strings above which the default has fewer: a node costs more there, and gains less."""


class SplitSettings(Choice):
    """What is minimised, and when a search stops.

    Attributes
    ----------
    objectives : Objectives
        Weights, priorities, tolerances, normalisation.
    gap : float
        Relative gap at which a search stops.
    node_limit : int or None
        Most relaxations solved for each priority: more raise the rigorous bound, and may find a better split.
        1 solves the root, where the rigorous gap is above 3 %; more are solved wherever it is above ``gap``.
        By default, where the rigorous gap is above 3 %, as many as make :data:`STEPS_OF_STRINGS` steps of
        single strings (300 for two strings and four steps, 150 for eight; above that fewer, with the square
        of the size), or as fit into ``time_limit_s`` if that is given. The policy ``mpc`` of a closed loop
        takes 1, unless a limit is given.
    time_limit_s : float or None
        Longest wall-clock time of a call; the best split known is then returned and flagged. Answers then
        depend on how fast the machine is, where ``node_limit`` bounds the work repeatably.
    """

    objectives: Objectives = Objectives()
    gap: Annotated[float, Field(strict=True), within(0.0, 1.0, above=True, below=True)] = 1e-3
    node_limit: Annotated[int, Field(strict=True), within(1, 1_000_000_000)] | None = None
    time_limit_s: Annotated[float, Field(strict=True), within(0.0, 1e9, "s")] | None = None

    def nodes(self, n_strings: int, n_steps: int) -> int:
        """Most relaxations solved for each priority of a problem of this size."""
        if self.node_limit is not None:
            return self.node_limit
        if self.time_limit_s is not None:
            return sys.maxsize
        size = n_strings * n_steps
        return max(1, STEPS_OF_STRINGS * LARGE // (size * max(size, LARGE)))
