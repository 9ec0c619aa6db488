"""The problem of a split or plan: the arguments of a call, checked against the plant and the horizon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bess import _core
from bess.arrays import Array, check_times, finite_array, step_hours
from bess.control.objectives import Costs
from bess.errors import InputError
from bess.system import State, System
from bess.system.system import check_system, surroundings_of_steps

MAX_HORIZON_STEPS = 96


@dataclass(frozen=True)
class SplitProblem:
    """A plant in a measured state, and its demand over the horizon."""

    system: System
    state: State
    demand_kw: Array
    """``(n_steps,)``: demand within the limits of the strings, signed; 0 if below the minimum power of all in
    service."""
    unmet_kw: Array
    """``(n_steps,)``: remaining demand, ``>= 0``."""
    ambient_c: Array
    limit_kw: Array
    """``(n_strings, n_steps)``: maximum request of each string."""
    dt_h: float
    """Length of a step [h]."""

    @classmethod
    def check(
        cls,
        system: System,
        n_steps: int,
        dt_h: float,
        state: State,
        demand_kw: ArrayLike,
        ambient_c: ArrayLike | None,
        limit_kw: ArrayLike | None,
    ) -> SplitProblem:
        """Check the arguments of a call."""
        system.check_state(state)
        demand = finite_array("demand_kw", demand_kw)
        if demand.ndim != 1 or demand.size != n_steps:
            raise InputError(
                f"demand_kw has shape {demand.shape}, but the split is for a horizon of {n_steps} steps; "
                "give one value for each step, or build a PowerSplit with that horizon"
            )
        check_times("demand_kw", demand_kw, dt_h)
        limit = _limits(system, n_steps, dt_h, limit_kw)
        max_kw = limit.sum(axis=0)
        served = np.minimum(np.maximum(demand, -max_kw), max_kw)
        # Demand below the minimum power of every inverter in service is treated as zero.
        min_kw = np.where(limit > 0.0, system.min_power_kw[:, None], np.inf).min(axis=0)
        served[np.abs(served) < min_kw] = 0.0
        return cls(
            system=system,
            state=state,
            demand_kw=served,
            unmet_kw=np.abs(demand - served),
            ambient_c=surroundings_of_steps(system, ambient_c, n_steps, dt_h),
            limit_kw=limit,
            dt_h=dt_h,
        )

    def control(self, costs: Costs, abs_tol: ArrayLike, rel_tol: ArrayLike) -> _core.ControlHorizon:
        """Return the control model over this horizon, with costs and tolerances of each group."""
        return _core.ControlHorizon(
            self.system.control_at(self.state),
            self.state.soc,
            self.state.temperature_c,
            self.demand_kw,
            self.ambient_c,
            self.dt_h,
            self.limit_kw,
            costs.reported,
            costs.searched,
            np.asarray(abs_tol),
            np.asarray(rel_tol),
        )


def demand_of_steps(demand_kw: ArrayLike) -> Array:
    """Return a demand of at least one step, ``(n_steps,)`` [kW]."""
    demand = finite_array("demand_kw", demand_kw)
    if demand.ndim != 1 or demand.size == 0:
        raise InputError(
            f"demand_kw has shape {demand.shape}; give one value for each step, such as [78.0] * 96"
        )
    return demand


def check_horizon(
    system: System, horizon_steps: int, dt_h: float, max_steps: int = MAX_HORIZON_STEPS
) -> tuple[int, float]:
    """Return the prediction horizon of a split or a plan in steps, and the step [h], both checked."""
    check_system(system)
    whole = isinstance(horizon_steps, int | np.integer) and not isinstance(horizon_steps, bool)
    if not whole or not 1 <= horizon_steps <= max_steps:
        raise InputError(f"horizon_steps {horizon_steps!r} must be an integer from 1 to {max_steps}")
    dt_h = step_hours(dt_h)
    fastest = max(s.thermal.lumped.k2_per_s for s in system.strings) * dt_h * 3600.0
    if fastest >= 1.0:
        raise InputError(
            f"dt_h {dt_h:g} h is too long for the lumped thermal model: k2 dt is {fastest:g}, not below 1"
        )
    return int(horizon_steps), dt_h


def _limits(system: System, n_steps: int, dt_h: float, limit_kw: ArrayLike | None) -> Array:
    """Return the maximum requests ``(n_strings, n_steps)`` [kW], 0 if below the minimum power."""
    shape, nominal = (system.n_strings, n_steps), system.nominal_kw[:, None]
    if limit_kw is None:
        return nominal.repeat(n_steps, axis=1)
    limit = finite_array("limit_kw", limit_kw)
    if limit.shape not in (shape[:1], shape):
        raise InputError(
            f"limit_kw has shape {limit.shape}; give one value for each string (and step), {shape}"
        )
    if limit.ndim > 1:
        check_times("limit_kw", limit_kw, dt_h)
    limit = limit.reshape(system.n_strings, -1)
    bad = (limit < 0.0) | (limit > nominal * (1.0 + 1e-9))
    if bad.any():
        string, step = np.argwhere(bad)[0]
        raise InputError(
            f"limit_kw of string {string} at step {step} is {limit[string, step]:g} kW, outside "
            f"[0, {nominal[string, 0]:g}] kW"
        )
    limit = np.where(limit < system.min_power_kw[:, None], 0.0, limit)
    return limit if limit.shape == shape else limit.repeat(n_steps, axis=1)
