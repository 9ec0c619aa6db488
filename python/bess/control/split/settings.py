"""Settings of a power split: names, ranges and defaults.

Section ``[policy]`` of a study and the keywords of :class:`bess.PowerSplit` use these settings.
"""

from __future__ import annotations

import sys
from typing import Annotated, Final

from bess.control.objectives import Objectives
from bess.system.quantities import within
from bess.system.section import PublicSection

ROLLOUTS: Final = 2000
"""Effort of one descent of the search on the control model, in roll-outs."""

STEPS_OF_STRINGS: Final = 2400
"""Default string-steps (strings x steps) in all nodes of one priority, up to half a second."""

LARGE: Final = 8
"""String-steps above which the default solves fewer nodes: each node costs more and gains less."""


class SplitSettings(PublicSection):
    """Objectives and stopping criteria."""

    objectives: Objectives = Objectives()
    """Weights, priorities, tolerances, normalisation."""
    gap: Annotated[float, within(0.0, 1.0, above=True, below=True)] = 1e-3
    """Relative gap at which a search stops."""
    node_limit: Annotated[int, within(1, 1_000_000_000)] | None = None
    """Maximum number of nodes of the branch and bound of each priority; the second part of the last branched
    node may exceed it, and the root of the convexified program is solved in addition. More nodes raise the
    rigorous bound and may find a better split. With 1, the root is solved if the rigorous gap exceeds 3 %;
    with a larger limit, nodes are solved while the rigorous gap exceeds ``gap``. By default, nodes are
    solved if the rigorous gap exceeds 3 %: as many as make :data:`STEPS_OF_STRINGS` string-steps (300 for
    two strings and four steps, 75 for two strings and eight steps: for larger problems fewer, with the
    square of the size), or as fit into ``time_limit_s`` if given. The policy ``mpc`` of a closed loop uses
    1 unless a limit is given."""
    time_limit_s: Annotated[float, within(0.0, 1e9, "s")] | None = None
    """Maximum wall-clock time of a call; the incumbent is then returned and flagged. Results then depend on
    the speed of the machine; ``node_limit`` limits the computing effort reproducibly."""

    def nodes(self, n_strings: int, n_steps: int) -> int:
        """Maximum number of nodes of each priority of a problem of this size."""
        if self.node_limit is not None:
            return self.node_limit
        if self.time_limit_s is not None:
            return sys.maxsize
        size = n_strings * n_steps
        return max(1, STEPS_OF_STRINGS * LARGE // (size * max(size, LARGE)))
