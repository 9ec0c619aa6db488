"""What a power split returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bess.split.rollout import Rollout

from bess.display import as_table, few, one_line
from bess.numbers import Array, ByValue


class SplitStatus(Enum):
    """What is proven about a split, and of which program; ``str()`` is a sentence, ``code`` the integer
    stored in results.

    The **nonlinear control model** is what the requests are rolled out with. In the **convexified program**
    its coefficients are frozen along the requests returned.
    """

    NO_DEMAND = (0, "There is no demand within the horizon, so every string stays off.")
    OPTIMAL = (1, "No split of the nonlinear control model is better by more than the gap asked for.")
    CONVEXIFIED_CLOSED = (
        2,
        "No split of the convexified program is better by more than the gap asked for; "
        "against the nonlinear control model only the rigorous gap is proven.",
    )
    TREE_CLOSED = (
        3,
        "Every node of the convexified program is closed, but more than the gap asked for is left in them.",
    )
    TOO_LARGE = (
        7,
        "The problem is too large to relax; this is the best split found, "
        "with a bound from its steps one by one.",
    )
    NODE_LIMIT = (4, "The node limit was reached; this is the best split found.")
    TIME_LIMIT = (5, "The time limit was reached; this is the best split found.")
    SOLVER_FAILED = (
        6,
        "The solver failed on the relaxation; this is the best split found, without a bound of its own.",
    )

    def __init__(self, code: int, sentence: str) -> None:
        self.code = code
        self.sentence = sentence

    def __str__(self) -> str:
        return self.sentence

    @property
    def is_fallback(self) -> bool:
        """Whether the answer was taken because the search could not finish."""
        return self in (SplitStatus.TIME_LIMIT, SplitStatus.SOLVER_FAILED)


@dataclass(frozen=True)
class GroupResult:
    """One priority: its members, and its objective against lower bounds.

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
        Lower bound of the program with coefficients frozen along the returned requests; zero weights count
        with their tie-break weight here.
    gap, search_gap : float
        Relative distance of the objective from each.
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
    """Answer of the power split for one horizon. Powers are kW, positive = discharge.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
        Set-points.
    inverter_on, low_soc, saturated : ndarray of bool, shape (n_strings, n_steps)
        Inverter delivers; SOC is below the low-SOC switch at the start of the step; power is shed at a SOC
        limit.
    rollout : Rollout
        Control model under these requests.
    availability_loss_kw : float
        Sum over strings and steps.
    objective, bound, gap, search_gap : float
        Of the lowest priority, see :class:`GroupResult`.
    groups : tuple of GroupResult
        Every priority, the highest first.
    unmet_kw : ndarray, shape (n_steps,)
        Demand above what the strings may be asked for, ``>= 0``.
    nodes : int
        Relaxations solved by Clarabel.
    solve_time_s : float
    status : SplitStatus
        Of which program what is proven; :attr:`statement` adds the gaps.
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
            "set-points now": few(self.request_kw[:, 0], ".3g", "kW"),
            "steps": str(self.request_kw.shape[1]),
            "status": str(self.status),
            "gap": f"{100.0 * self.gap:.2g} %",
            "solve time": f"{1e3 * self.solve_time_s:.3g} ms",
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
        """Relative distance of the objective from the optimum of the convexified program."""
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
            f"{self.status} The rigorous gap is {gap:.2g} %, "
            f"that of the convexified program {search_gap:.2g} %."
        )

    @property
    def fallback(self) -> bool:
        """Whether the search could not finish and the best split known was taken."""
        return self.status.is_fallback


def relative_gap(objective: float, bound: float) -> float:
    """Return ``(objective - bound) / objective``, 0 where both vanish."""
    difference = max(objective - bound, 0.0)
    return 0.0 if difference <= 1e-12 else difference / abs(objective)
