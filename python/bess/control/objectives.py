"""Objectives of the power split: four losses with weights, priorities and tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from bess.arrays import Array
from bess.system.quantities import NonNegative
from bess.system.section import PublicSection

NAMES: Final = ("availability", "derating", "inverter", "battery")
TIE_BREAK_WEIGHT: Final = 2e-4
"""Search weight of an objective with zero weight, so that its relaxed loss is tight. A five times larger
weight raises the objective by up to 0.3 % on hot states."""

SHORTFALL: Final = 3.0
"""Weight of undelivered energy relative to losses [kWh/kWh]."""
START_KWH: Final = 0.15
"""Cost of a start [kWh of losses] of an inverter of 92 kW; up to this price fewer starts cost no energy."""
_START_KW: Final = 92.0

Kind = Literal["paper", "energy", "money"]
Normalisation = Literal["constant", "payoff", "energy"]


class Objective(PublicSection):
    """One objective, in the words of HiGHS and Gurobi.

    Attributes
    ----------
    weight : float
        Weight within its priority, ``>= 0``.
    priority : int
        Larger priorities are minimised first; equal priorities are blended. The kind of the
        :class:`Objectives` sets the default.
    abs_tol, rel_tol : float
        While lower priorities are minimised, the group may exceed its optimum ``F*`` by
        ``max(abs_tol, rel_tol |F*|)``; it may not exceed an ``F*`` of 0. A group has the smallest tolerance
        of its members.
    """

    weight: NonNegative = 1.0
    priority: Annotated[int, Field(strict=True)] = 1
    abs_tol: NonNegative = 2e-5
    rel_tol: NonNegative = 5e-5

    def __init__(self, weight: float | None = None, priority: int | None = None, **tolerances: float) -> None:
        given = {"weight": weight, "priority": priority}
        super().__init__(**{name: value for name, value in given.items() if value is not None}, **tolerances)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


def _weight_alone(value: object) -> object:
    return value if isinstance(value, Mapping | Objective) else {"weight": value}


Weighted = Annotated[
    Objective, BeforeValidator(_weight_alone, json_schema_input_type=Objective | NonNegative)
]
"""An objective; a number is its weight."""


class Costs(NamedTuple):
    """Costs of the four losses [1/kW], each of shape ``(n_groups, n_strings, 4)``."""

    reported: Array
    """Costs with the given weights, for reported values and bounds."""
    searched: Array
    """Costs of the search, with :data:`TIE_BREAK_WEIGHT` in place of zero weights."""


class Objectives(PublicSection):
    """The four objectives: section ``[policy.objectives]`` of a study, and ``bess.Objectives``.

    Kind ``paper`` follows [1]_.

    Each objective is a weight, or an :class:`Objective` (a table) with priority and tolerances. ``kind`` sets
    the defaults:

    - ``"paper"``: all weights 1, availability at priority 2 and the rest at 1, ``"constant"`` normalisation
      (case 1 of the paper; ``Objectives(inverter=0.5, battery=0.5)`` is weighting S2 of its case 2);
    - ``"energy"``: one sum in kWh, ``shortfall`` x undelivered energy (availability and derating loss) +
      inverter and battery losses;
    - ``"money"``: one sum in EUR at the prices over the prediction horizon; the weights multiply the prices
      of the four losses. It requires plans (:class:`bess.control.planning.Planner`) and a study with prices.

    Attributes
    ----------
    kind : {"paper", "energy", "money"}
    shortfall : float or None
        Weight of undelivered energy over losses; kind ``"energy"`` only, 3 by default.
    start_kwh : float or None
        Cost of an inverter start in plans [kWh of losses]; kinds ``"energy"`` and ``"money"`` only. The
        default is 0.15 for inverters of 92 kW; ``mpc`` and :func:`bess.plan_power` take others in proportion
        (:meth:`for_inverters`). A certified split ignores it, because its horizon is short.
    normalisation : {"constant", "payoff", "energy"}
        Divisor of each loss. ``"constant"``: its value at nominal power on every string and step, so that a
        kWh has the same weight in every string. ``"payoff"``: its range over the optima of the single
        objectives, recomputed in each call. ``"energy"``: none; objectives are in kWh.
    availability, derating, inverter, battery : Objective
        Availability loss, derating loss, inverter loss, battery loss.

    Raises
    ------
    InputError
        Negative or non-finite weight or tolerance, priority that is not an integer, all weights zero.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    """

    kind: Kind = "paper"
    shortfall: NonNegative | None = None
    start_kwh: NonNegative | None = None
    normalisation: Normalisation = "constant"
    availability: Weighted = Objective()
    derating: Weighted = Objective()
    inverter: Weighted = Objective()
    battery: Weighted = Objective()

    if TYPE_CHECKING:

        def __init__(
            self,
            *,
            kind: Kind = "paper",
            shortfall: float | None = None,
            start_kwh: float | None = None,
            normalisation: Normalisation = "constant",
            availability: Objective | Mapping[str, float] | float = 1.0,
            derating: Objective | Mapping[str, float] | float = 1.0,
            inverter: Objective | Mapping[str, float] | float = 1.0,
            battery: Objective | Mapping[str, float] | float = 1.0,
        ) -> None: ...

    @classmethod
    def paper(cls, **given: Any) -> Self:
        """Objectives of the paper's case 1, the default; keywords as for the class."""
        return cls(kind="paper", **given)

    @classmethod
    def energy(cls, shortfall: float = SHORTFALL, **given: Any) -> Self:
        """One sum in kWh: ``shortfall`` x (availability + derating loss) + inverter + battery loss."""
        return cls(kind="energy", shortfall=shortfall, **given)

    @classmethod
    def money(cls, **given: Any) -> Self:
        """One sum in EUR at the prices of the study."""
        return cls(kind="money", **given)

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        """Fill in the defaults of the kind; given values remain marked as given."""
        energy, planned = self.kind == "energy", self.kind != "paper"
        if not energy and self.shortfall is not None:
            raise ValueError(f'shortfall is for kind = "energy"; with "{self.kind}", set weights')
        if not planned and self.start_kwh is not None:
            raise ValueError('start_kwh is for kind = "energy" or "money"; "paper" has no cost of starts')
        if energy and self.shortfall is None:
            object.__setattr__(self, "shortfall", SHORTFALL)
        if planned and self.start_kwh is None:
            object.__setattr__(self, "start_kwh", START_KWH)
        if planned and "normalisation" not in self.model_fields_set:
            object.__setattr__(self, "normalisation", "energy")
        for name in NAMES:
            given: Objective = getattr(self, name)
            usual: dict[str, Any] = {"priority": 2 if name == "availability" and self.kind == "paper" else 1}
            if energy and name in ("availability", "derating"):
                usual["weight"] = self.shortfall
            values = usual | given.model_dump(exclude_unset=True)
            resolved = Objective.model_construct(_fields_set=set(given.model_fields_set), **values)
            object.__setattr__(self, name, resolved)
        if not any(objective.weight > 0.0 for objective in self.members):
            raise ValueError("at least one weight must be positive")
        return self

    def for_inverters(self, nominal_kw: Array) -> Self:
        """Return these objectives for inverters of this nominal power, of shape ``(n_strings,)``.

        The default price of a start is in proportion to the mean: a plant of twice the size has the same
        plans, twice.
        """
        if self.start_kwh is None or "start_kwh" in self.model_fields_set:
            return self
        return self.model_copy(update={"start_kwh": START_KWH * (float(nominal_kw.mean()) / _START_KW)})

    @property
    def members(self) -> tuple[Objective, Objective, Objective, Objective]:
        """The four objectives in the order of :data:`NAMES`."""
        return (self.availability, self.derating, self.inverter, self.battery)

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Indices into :data:`NAMES` for each priority, in the order of minimisation."""
        priorities = sorted({o.priority for o in self.members}, reverse=True)
        return tuple(
            tuple(i for i, o in enumerate(self.members) if o.priority == priority) for priority in priorities
        )

    @cached_property
    def tolerances(self) -> tuple[tuple[float, ...], ...]:
        """Absolute and relative tolerance of each group."""
        return tuple(
            tuple(min(getattr(self.members[i], name) for i in group) for group in self.groups)
            for name in ("abs_tol", "rel_tol")
        )

    def costs(self, scale_per_kw: Array) -> Costs:
        """Cost of one kW of each loss in each group; ``scale_per_kw`` is the normalisation [1/kW], of shape
        ``(n_strings, 4)``."""
        weights = np.array([objective.weight for objective in self.members])
        search_weights = np.where(weights == 0.0, TIE_BREAK_WEIGHT, weights)
        for group in self.groups:
            # A priority of zero weights only is no objective: there is nothing to break a tie of.
            search_weights[list(group)] *= weights[list(group)].any()
        reported, searched = (np.zeros((len(self.groups), *scale_per_kw.shape)) for _ in range(2))
        for g, group in enumerate(self.groups):
            for i in group:
                reported[g, :, i] = weights[i] * scale_per_kw[:, i]
                searched[g, :, i] = search_weights[i] * scale_per_kw[:, i]
        return Costs(reported, searched)
