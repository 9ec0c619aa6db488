"""Result of a power split."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bess.control.rollout import Rollout

from bess.arrays import Array, ByValue
from bess.display import as_table, few, one_line, rounded


class SplitStatus(Enum):
    """Solution status of a split; ``str()`` is a sentence, ``code`` the integer stored in results.

    The **nonlinear control model** rolls out the requests. The **convexified program** freezes its
    coefficients along the returned requests.
    """

    NO_DEMAND = (0, "No demand within the horizon; every string stays off.")
    OPTIMAL = (1, "Optimal within the requested gap (control model).")
    CONVEXIFIED_CLOSED = (
        2,
        "Optimal within the requested gap (convexified program); "
        "for the control model, only the rigorous gap is proven.",
    )
    TREE_CLOSED = (
        3,
        "Every node of the convexified program is closed, but the gap exceeds the requested gap.",
    )
    TOO_LARGE = (
        7,
        "The problem is too large to relax; best split found, with a bound from single steps.",
    )
    NODE_LIMIT = (4, "Node limit reached, or no nodes spent on a small gap; best split found.")
    TIME_LIMIT = (5, "Time limit reached; best split found.")
    SOLVER_FAILED = (
        6,
        "The solver failed on the relaxation; best split found, without a bound from the relaxation.",
    )

    def __init__(self, code: int, sentence: str) -> None:
        self.code = code
        self.sentence = sentence

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class GroupResult:
    """One priority: its members, objective and lower bounds.

    Attributes
    ----------
    priority : int
    members : tuple of str
        Objectives blended in this group.
    objective : float
        Weighted sum of normalised losses of the returned requests, from the roll-out.
    bound : float
        Lower bound of the nonlinear control model.
    search_bound : float
        Lower bound of the program with coefficients frozen along the returned requests; zero weights are
        replaced by their tie-break weight.
    gap, search_gap : float
        Relative distance of the objective from ``bound`` and ``search_bound``.
    """

    priority: int
    members: tuple[str, ...]
    objective: float
    bound: float
    search_bound: float
    gap: float
    search_gap: float


@dataclass(frozen=True, eq=False)
class Split(ByValue):
    """Result of the power split for one horizon. Powers are kW, positive = discharge.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
        Set-points.
    inverter_on, low_soc, saturated : ndarray of bool, shape (n_strings, n_steps)
        Inverter delivers power; SOC is below the low-SOC switch at the start of the step; a SOC limit reduces
        the power.
    rollout : Rollout
        Response of the control model to these requests.
    availability_loss_kw : float
        Sum over strings and steps.
    objective, bound, gap, search_gap : float
        Values of the lowest priority, see :class:`GroupResult`.
    groups : tuple of GroupResult
        Results of all priorities, the highest first.
    unmet_kw : ndarray, shape (n_steps,)
        Demand above the limits of the strings, ``>= 0``.
    nodes : int
        Relaxations solved by Clarabel.
    solve_time_s : float
    status : SplitStatus
        Solution status; :attr:`statement` adds the gaps.
    """

    request_kw: Array
    inverter_on: NDArray[np.bool_]
    low_soc: NDArray[np.bool_]
    saturated: NDArray[np.bool_]
    rollout: Rollout
    groups: tuple[GroupResult, ...]
    unmet_kw: Array
    nodes: int
    solve_time_s: float = field(compare=False)
    status: SplitStatus

    def _facts(self) -> dict[str, str]:
        return {
            "set-points now": few(self.request_kw[:, 0], "kW"),
            "steps": str(self.request_kw.shape[1]),
            "status": str(self.status),
            "gap": f"{rounded(100.0 * self.gap)} %",
            "solve time": f"{rounded(1e3 * self.solve_time_s, 3)} ms",
        }

    __repr__ = one_line
    _repr_html_ = as_table

    @property
    def availability_loss_kw(self) -> float:
        """Availability loss, summed over strings and steps [kW]."""
        return float(self.rollout.availability_loss_kw.sum())

    @property
    def objective(self) -> float:
        """Objective of the lowest priority."""
        return self.groups[-1].objective

    @property
    def bound(self) -> float:
        """Rigorous lower bound of :attr:`objective`."""
        return self.groups[-1].bound

    @property
    def gap(self) -> float:
        """Relative distance of :attr:`objective` from :attr:`bound`."""
        return self.groups[-1].gap

    @property
    def search_gap(self) -> float:
        """Relative distance of the objective from the optimum of the convexified program, or its bound."""
        return self.groups[-1].search_gap

    @property
    def statement(self) -> str:
        """The status in a sentence or two, with both gaps in per cent."""
        if self.status is SplitStatus.NO_DEMAND:
            return str(self.status)
        gap, search_gap = (
            100.0 * max(getattr(group, name) for group in self.groups) for name in ("gap", "search_gap")
        )
        return (
            f"{self.status} The rigorous gap is {rounded(gap)} %, "
            f"that of the convexified program {rounded(search_gap)} %."
        )

    @property
    def fallback(self) -> bool:
        """Whether the search ended early and the incumbent was returned."""
        return self.status in (SplitStatus.TIME_LIMIT, SplitStatus.SOLVER_FAILED)


def relative_gap(objective: float, bound: float) -> float:
    """Return ``(objective - bound) / objective``, 0 where both vanish."""
    difference = max(objective - bound, 0.0)
    return 0.0 if difference <= 1e-12 else difference / abs(objective)
