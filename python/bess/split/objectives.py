"""What the power split minimises: four normalised losses with weights, priorities and tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError

NAMES: Final = ("availability", "derating", "inverter", "battery")
TIE_BREAK_WEIGHT: Final = 2e-4
"""Weight inside the search of an objective whose weight is zero: nothing else would press its loss onto its
table. Five times as much (MODEL.md section 4) costs up to 0.3 % of what is minimised on hot states."""

Normalisation = Literal["constant", "payoff"]


@dataclass(frozen=True)
class Objective:
    """One objective, in the words of HiGHS and Gurobi.

    Attributes
    ----------
    weight : float
        Weight within its priority, ``>= 0``.
    priority : int
        Larger is minimised first; equal priorities are blended.
    abs_tol, rel_tol : float
        Its group may be worse than its optimum ``F*`` by ``max(abs_tol, rel_tol |F*|)`` while lower
        priorities are minimised; the group takes the smallest of its members.
    """

    weight: float = 1.0
    priority: int = 1
    abs_tol: float = 2e-5
    rel_tol: float = 5e-5

    def __post_init__(self) -> None:
        if isinstance(self.priority, bool) or not isinstance(self.priority, int | np.integer):
            raise InputError(f"objective priority {self.priority!r} must be an integer (larger is first)")
        for name in ("weight", "abs_tol", "rel_tol"):
            value = getattr(self, name)
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not number or not math.isfinite(value) or value < 0.0:
                raise InputError(f"objective {name} {value!r} must be a finite number >= 0")


@dataclass(frozen=True, init=False)
class Objectives:
    """The four objectives. Keywords take a weight, or an :class:`Objective` for priority and tolerances as
    well.

    Availability has priority 2 by default, the others 1 (case 1 of the paper); ``Objectives(inverter=0.5,
    battery=0.5)`` is weighting S2 of its case 2.

    Parameters
    ----------
    availability, derating, inverter, battery : float or Objective
        Availability loss, derating loss, inverter loss, battery loss.
    normalisation : {"constant", "payoff"}
        Divide each loss by its value at nominal power on every string and step, so that a kWh counts the same
        in whichever string it is lost (MODEL.md section 3), or by its range over the optima of the single
        objectives, found anew for each call.

    Raises
    ------
    InputError
        Negative or non-finite weight or tolerance, priority that is not an integer, all weights zero.
    """

    availability: Objective
    derating: Objective
    inverter: Objective
    battery: Objective
    normalisation: Normalisation = field(default="constant")

    def __init__(
        self,
        availability: float | Objective = 1.0,
        derating: float | Objective = 1.0,
        inverter: float | Objective = 1.0,
        battery: float | Objective = 1.0,
        *,
        normalisation: Normalisation = "constant",
    ) -> None:
        for name, given in zip(NAMES, (availability, derating, inverter, battery), strict=True):
            default = Objective(priority=2 if name == "availability" else 1)
            try:
                value = given if isinstance(given, Objective) else Objective(given, default.priority)
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
            object.__setattr__(self, name, value)
        if normalisation not in get_args(Normalisation):
            raise InputError(
                f"normalisation {normalisation!r} is unknown; allowed: {', '.join(get_args(Normalisation))}"
            )
        object.__setattr__(self, "normalisation", normalisation)
        if not any(objective.weight > 0.0 for objective in self.members):
            raise InputError("objectives: at least one weight must be positive")

    @property
    def members(self) -> tuple[Objective, Objective, Objective, Objective]:
        """The four objectives in the order of :data:`NAMES`."""
        return (self.availability, self.derating, self.inverter, self.battery)

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Indices into :data:`NAMES` for each priority, the first to be minimised first."""
        priorities = sorted({o.priority for o in self.members}, reverse=True)
        return tuple(
            tuple(i for i, o in enumerate(self.members) if o.priority == priority) for priority in priorities
        )

    @property
    def tolerances(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Absolute and relative tolerance of each group."""
        pairs = [
            [min(getattr(self.members[i], name) for i in group) for group in self.groups]
            for name in ("abs_tol", "rel_tol")
        ]
        return np.array(pairs[0]), np.array(pairs[1])

    def costs(self, scale_per_kw: NDArray[np.float64], *, tie_break: bool) -> NDArray[np.float64]:
        """Cost of one kW of each loss in each group.

        Parameters
        ----------
        scale_per_kw : ndarray, shape (n_strings, 4)
            Normalisation constants [1/kW].
        tie_break
            Give zero weights :data:`TIE_BREAK_WEIGHT`: for the search, never for what is reported.

        Returns
        -------
        ndarray, shape (n_groups, n_strings, 4)
            Costs [1/kW].
        """
        costs = np.zeros((len(self.groups), *scale_per_kw.shape))
        for g, group in enumerate(self.groups):
            for i in group:
                weight = self.members[i].weight
                if tie_break and weight == 0.0:
                    weight = TIE_BREAK_WEIGHT
                costs[g, :, i] = weight * scale_per_kw[:, i]
        return costs
