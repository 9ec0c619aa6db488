"""The control model on given requests (docs/equations.md, 1 to 6)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import _core
from bess.arrays import ByValue, check_times, finite_array, step_hours
from bess.display import as_table, few, one_line
from bess.errors import InputError
from bess.system import State, System
from bess.system.system import check_system, surroundings_of_steps

Model = Literal["start", "midpoint"]
"""Form of the control model: coefficients of the start or of the middle of each step."""

# Relative tolerance of a request above nominal power, for the rounding of a sum.
_SLACK: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Rollout(ByValue):
    """Response of the control model to requests. Powers are kW, positive = discharge; losses are ``>= 0``.

    All arrays have the shape of the requests, ``(..., n_strings, n_steps)``.

    Attributes
    ----------
    delivered_kw : ndarray
        AC power of each string.
    availability_loss_kw, derating_loss_kw : ndarray
        Requested but undelivered power, because of SOC limits (or no real root of the current) and because of
        temperature.
    inverter_loss_kw, battery_loss_kw : ndarray
        Losses of the delivered power.
    current_a : ndarray
        String current; positive = discharge.
    soc, temperature_c : ndarray
        State at the END of each step.
    """

    delivered_kw: NDArray[np.float64]
    availability_loss_kw: NDArray[np.float64]
    derating_loss_kw: NDArray[np.float64]
    inverter_loss_kw: NDArray[np.float64]
    battery_loss_kw: NDArray[np.float64]
    current_a: NDArray[np.float64]
    soc: NDArray[np.float64]
    temperature_c: NDArray[np.float64]

    def _facts(self) -> dict[str, str]:
        *batch, strings, steps = self.soc.shape
        facts = {"steps": str(steps), "strings": str(strings)}
        if batch:
            return {"schedules": " x ".join(map(str, batch)), **facts}
        return facts | {
            "soc at the end": few(self.soc[:, -1]),
            "temperature at the end": few(self.temperature_c[:, -1], "°C"),
        }

    __repr__ = one_line
    _repr_html_ = as_table

    @classmethod
    def of(cls, flows: _core.FlowArrays, shape: tuple[int, ...] | None = None) -> Rollout:
        """Wrap the arrays of the core, reshaped if ``shape`` is given."""
        arrays = (getattr(flows, field.name) for field in fields(cls))
        return cls(*(array if shape is None else array.reshape(shape) for array in arrays))


def rollout(
    system: System,
    state: State,
    request_kw: ArrayLike,
    dt_h: float = 0.25,
    ambient_c: ArrayLike | None = None,
    *,
    model: Model = "start",
) -> Rollout:
    """Roll out requests with the control model, the plant model of the controller (equations 1 to 6).

    The control model is that of [1]_; the page on equations documents the details.

    Parameters
    ----------
    system : System
        The plant's parameters.
    state : State
        Measured state at the start.
    request_kw : array_like, shape (..., n_strings, n_steps)
        Requested AC power [kW], positive = discharge, at most nominal power. All strings of a step have the
        same sign. A batch of schedules is rolled out in one call.
    dt_h : float
        Length of a step [h].
    ambient_c : float or array_like, shape (n_steps,), optional
        Ambient temperature [degC]; the system's by default. For a system with cooling, the temperature that
        its strings cool towards (:meth:`~bess.System.surroundings_c`).
    model : {"start", "midpoint"}
        Point at which open-circuit voltage, resistance and derating factor are evaluated: the start of each
        step, as in the paper and in the certified split, or its middle, as in plans (docs/foresight.md).

    Returns
    -------
    Rollout
        Arrays of the shape of ``request_kw``.

    Raises
    ------
    InputError
        A shape, a value or a sign is invalid, or ``state`` does not fit ``system``.

    References
    ----------
    .. [1] Tanjavooru, V. T., Pant, P., Hamacher, T., Hesse, H.: Multi-objective nonlinear power split control
       for BESS with real-time simulation feedback. 2025, arXiv:2507.04800.
    """
    check_system(system)
    system.check_state(state)
    request = finite_array("request_kw", request_kw)
    if request.ndim < 2 or request.shape[-2] != system.n_strings or request.shape[-1] == 0:
        raise InputError(
            f"request_kw has shape {request.shape}; give (n_strings, n_steps) with n_strings = "
            f"{system.n_strings} and at least one step, or a batch of them along leading axes"
        )
    _check_requests(system, request)
    dt_h = step_hours(dt_h)
    check_times("request_kw", request_kw, dt_h)
    if model not in get_args(Model):
        raise InputError(f'model = {model!r} must be one of "start" and "midpoint"')

    shape, n_steps = request.shape, request.shape[-1]
    arrays = system.control_at(state).rollout(
        state.soc,
        state.temperature_c,
        request.reshape(-1, system.n_strings, n_steps),
        surroundings_of_steps(system, ambient_c, n_steps, dt_h),
        dt_h,
        model == "midpoint",
    )
    return Rollout.of(arrays, shape)


def _check_requests(system: System, request: NDArray[np.float64]) -> None:
    above = np.abs(request) > system.nominal_kw[:, None] * (1.0 + _SLACK)
    if np.any(above):
        *_, string, step = place = tuple(int(i) for i in np.argwhere(above)[0])
        nominal = system.nominal_kw[string]
        raise InputError(
            f"request_kw: string {string}, step {step}: {request[place]:g} kW is outside "
            f"[-{nominal:g}, {nominal:g}] kW"
        )
    mixed = np.any(request > 0.0, axis=-2) & np.any(request < 0.0, axis=-2)
    if np.any(mixed):
        step = int(np.argwhere(mixed)[0][-1])
        raise InputError(
            f"request_kw: step {step} has both signs; all strings of a step charge, or all discharge"
        )
