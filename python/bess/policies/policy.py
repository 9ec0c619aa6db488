"""What a policy is: the one seam between the closed loop and whatever decides how power is shared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from bess.parameters import State

NO_OPTIMISATION: Final = 0
"""Status code of a step that needed no solver: an idle step, or a policy without one."""


@dataclass(frozen=True)
class Situation:
    """What a policy knows when a control step begins.

    Attributes
    ----------
    state : State
        Measured state of every string.
    demand_kw : ndarray, shape (n_steps,)
        Signed demand of this step (never more than ``limit_kw`` allows in total) and forecast of the next
        ones.
    ambient_c : ndarray, shape (n_steps,)
        Ambient temperature [degC] of this step and the next ones; of a system with cooling, what its strings
        cool towards.
    limit_kw : ndarray, shape (n_strings,)
        Largest power of each inverter in service; 0 = out of service.
    price_eur_mwh : ndarray, shape (n_steps,), optional
        Price of energy, of studies that have one.
    follows_store : bool
        Whether what is foreseen follows from what will be in store, as behind a meter: a store that is full
        sooner is asked to charge less, one that is empty to discharge no more.
    reactive_kvar : ndarray, shape (n_steps,), or None
        Reactive power asked of the plant in this step and the next ones, signed [kvar]; None if none is.
    """

    state: State
    demand_kw: NDArray[np.float64]
    ambient_c: NDArray[np.float64]
    limit_kw: NDArray[np.float64]
    price_eur_mwh: NDArray[np.float64] | None = None
    follows_store: bool = False
    reactive_kvar: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class SolverReport:
    """What a policy's optimiser says about its answer; the default is that of policies without one."""

    status: int = NO_OPTIMISATION
    gap: float = np.nan
    search_gap: float = np.nan
    nodes: int = 0
    solve_time_s: float = 0.0
    fallback: bool = False


@dataclass(frozen=True)
class Decision:
    """Set-points of this step, signed [kW], shape ``(n_strings,)``; they sum to the demand.

    ``reactive_kvar`` is what each string carries of the reactive power that is asked for; of a policy that
    leaves it out it is shared in equal parts among the strings that run.
    """

    request_kw: NDArray[np.float64]
    solver: SolverReport = field(default_factory=SolverReport)
    reactive_kvar: NDArray[np.float64] | None = None


class Policy(Protocol):
    """Decides how the demand of a step is shared among the strings.

    The answer depends on the situation and on :meth:`memory` only, so a run that is continued from a
    checkpoint gives the same answers.
    """

    @property
    def statuses(self) -> Mapping[int, str]:
        """Meaning of each status code this policy can report."""

    def __call__(self, situation: Situation) -> Decision:
        """Share ``situation.demand_kw[0]`` among the strings."""

    def memory(self) -> dict[str, Any]:
        """What the policy carries from step to step, as plain values and arrays."""

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
