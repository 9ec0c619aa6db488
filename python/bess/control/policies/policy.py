"""Interface of policies: inputs and decisions between the closed loop and a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from bess.arrays import ByValue, read_only
from bess.system import State

NO_OPTIMISATION: Final = 0
"""Status code of a step without a solve: it leaves no choice, or the policy has no solver."""


@dataclass(frozen=True, eq=False)
class PolicyInput(ByValue):
    """Inputs of a policy at the start of a control step; its arrays are read-only.

    Attributes
    ----------
    state : State
        Measured state of every string.
    demand_kw : ndarray, shape (n_steps,)
        Signed demand of this step (at most the sum of ``limit_kw``) and forecast of the next steps [kW].
    ambient_c : ndarray, shape (n_steps,)
        Ambient temperature [degC] of this step and the next ones. For a system with cooling, the temperature
        that its strings cool towards.
    limit_kw : ndarray, shape (n_strings,)
        Maximum power of each inverter in this step [kW]; 0 = out of service.
    price_eur_mwh : ndarray, shape (n_steps,), optional
        Price of energy of this step and forecast of the next ones, if the study has one.
    demand_depends_on_soc : bool
        Whether the demand depends on the SOC, as behind a meter: a full battery receives less charging
        demand, and an empty one no discharging demand.
    reactive_kvar : ndarray, shape (n_steps,), or None
        Reactive power demand of this step and the next ones, signed [kvar]; None without one.
    limit_ahead_kw : ndarray, shape (n_strings, n_steps), or None
        Maximum power of each inverter in this step and the next ones [kW], as far as announced; None if
        ``limit_kw`` holds for all of them.
    """

    state: State
    demand_kw: NDArray[np.float64]
    ambient_c: NDArray[np.float64]
    limit_kw: NDArray[np.float64]
    price_eur_mwh: NDArray[np.float64] | None = None
    demand_depends_on_soc: bool = False
    reactive_kvar: NDArray[np.float64] | None = None
    limit_ahead_kw: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        # Views: the arrays are those of the closed loop, whose record and plant use them after the policy.
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value))

    @property
    def expected_limit_kw(self) -> NDArray[np.float64]:
        """``limit_ahead_kw``, or ``limit_kw`` if it holds for all steps."""
        return self.limit_kw if self.limit_ahead_kw is None else self.limit_ahead_kw


@dataclass(frozen=True)
class SolverReport:
    """Diagnostics of a policy's optimiser; the default is for policies without an optimiser."""

    status: int = NO_OPTIMISATION
    gap: float = np.nan
    search_gap: float = np.nan
    nodes: int = 0
    solve_time_s: float = 0.0
    fallback: bool = False


@dataclass(frozen=True, eq=False)
class Decision(ByValue):
    """Set-points of this step, signed [kW], shape ``(n_strings,)``; they sum to the demand.

    ``plan_kw``: set-points over the horizon, ``(n_strings, n_steps)``, this step first; None without a plan.
    ``reactive_kvar`` is the reactive power of each string. If a policy omits it, the reactive demand is
    allocated in equal parts to the strings that are on.
    """

    request_kw: NDArray[np.float64]
    solver: SolverReport = field(default_factory=SolverReport)
    reactive_kvar: NDArray[np.float64] | None = None
    plan_kw: NDArray[np.float64] | None = None


class Policy(Protocol):
    """Allocates the demand of a step to the strings.

    The decision depends on the policy input and on :meth:`state_dict` only, so a run that continues from a
    checkpoint gives the same results.

    A policy may have a method ``skip(demand_kw, limit_kw)``, with demand and forecast ``(n_steps,
    horizon_steps)`` and limits ``(n_steps, n_strings)`` of the next steps, both read-only. It returns the
    set-points ``(n, n_strings)`` of the first ``n`` of them, which need no optimisation, and advances past
    these steps.
    """

    @property
    def statuses(self) -> Mapping[int, str]:
        """Meaning of each status code of this policy."""

    def __call__(self, inputs: PolicyInput) -> Decision:
        """Allocate ``inputs.demand_kw[0]`` to the strings."""

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the policy between steps, as plain values and arrays."""

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore a state returned by :meth:`state_dict`."""
