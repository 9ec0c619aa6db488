"""Checks of what a power split is given; each problem is one :class:`InputError`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.errors import InputError
from bess.numbers import real_numbers
from bess.parameters import State, System
from bess.parameters.state import TEMPERATURE_RANGE_C

Array = NDArray[np.float64]

MAX_HORIZON_STEPS = 96
MAX_STRINGS = 32


@dataclass(frozen=True)
class HorizonInputs:
    """Checked inputs of one horizon.

    Attributes
    ----------
    state : State
    demand_kw : ndarray, shape (n_steps,)
        The part of the demand the strings can be asked for, signed.
    unmet_kw : ndarray, shape (n_steps,)
        The rest, ``>= 0``.
    ambient_c : ndarray, shape (n_steps,)
    limit_kw : ndarray, shape (n_strings, n_steps)
        Largest request of each string.
    """

    state: State
    demand_kw: Array
    unmet_kw: Array
    ambient_c: Array
    limit_kw: Array

    @classmethod
    def check(
        cls,
        system: System,
        n_steps: int,
        state: State,
        demand_kw: ArrayLike,
        ambient_c: ArrayLike | None,
        limit_kw: ArrayLike | None,
    ) -> HorizonInputs:
        """Check everything a call is given against the system and the compiled horizon."""
        if not isinstance(state, State):
            raise InputError(f"state must be a bess.State, not {type(state).__name__}")
        system.check_state(state)
        demand = _array("demand_kw", demand_kw)
        if demand.ndim != 1 or demand.size != n_steps:
            raise InputError(
                f"demand_kw has shape {demand.shape}, but the split is for a horizon of {n_steps} steps; "
                "give one value for each step, or build a PowerSplit with that horizon"
            )
        ambient = _array("ambient_c", system.ambient_c if ambient_c is None else ambient_c)
        if ambient.shape not in ((), (n_steps,)):
            raise InputError(
                f"ambient_c has shape {ambient.shape}; give one value, or one for each of {n_steps} steps"
            )
        low, high = TEMPERATURE_RANGE_C
        if np.any((ambient < low) | (ambient > high)):
            worst = ambient.ravel()[np.argmax(np.abs(ambient))]
            raise InputError(f"ambient_c {worst:g} degC is outside [{low:g}, {high:g}] degC")

        nominal = np.broadcast_to(system.nominal_kw[:, None], (system.n_strings, n_steps))
        limit = nominal
        if limit_kw is not None:
            limit = _array("limit_kw", limit_kw)
            if limit.shape == (system.n_strings,):
                limit = np.broadcast_to(limit[:, None], nominal.shape)
            if limit.shape != nominal.shape:
                raise InputError(
                    f"limit_kw has shape {limit.shape}; give one value for each string (and step), "
                    f"{nominal.shape}"
                )
            bad = np.argwhere((limit < 0.0) | (limit > nominal * (1.0 + 1e-9)))
            if bad.size:
                string, step = bad[0]
                raise InputError(
                    f"limit_kw of string {string} at step {step} is {limit[string, step]:g} kW, outside "
                    f"[0, {nominal[string, step]:g}] kW"
                )
        asked = np.clip(demand, -limit.sum(axis=0), limit.sum(axis=0))
        return cls(
            state=state,
            demand_kw=asked,
            unmet_kw=np.abs(demand - asked),
            ambient_c=np.ascontiguousarray(np.broadcast_to(ambient, (n_steps,))),
            limit_kw=np.ascontiguousarray(limit),
        )


def check_horizon(system: System, horizon_steps: int, dt_h: float) -> None:
    """Check the plant and the horizon that a :class:`PowerSplit` is built for."""
    if not isinstance(system, System):
        raise InputError(f"system must be a bess.System, not {type(system).__name__}")
    if system.n_strings > MAX_STRINGS:
        raise InputError(f"{system.n_strings} strings; the power split takes 1 to {MAX_STRINGS}")
    _integer("horizon_steps", horizon_steps, 1, MAX_HORIZON_STEPS)
    _number("dt_h", dt_h, " h", 0.0, 24.0)
    fastest = max(s.thermal.lumped.k2_per_s for s in system.strings) * dt_h * 3600.0
    if fastest >= 1.0:
        raise InputError(
            f"dt_h {dt_h:g} h is too long for the lumped thermal model: k2 dt is {fastest:g}, not below 1"
        )


def _array(name: str, values: ArrayLike) -> Array:
    try:
        array = real_numbers(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers ({error})") from error
    if not np.all(np.isfinite(array)):
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        place = f" at index {index if len(index) > 1 else index[0]}" if index else ""
        raise InputError(f"{name}{place} is {array[index]}; every value must be finite")
    return array


def _integer(name: str, value: object, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
        raise InputError(f"{name} {value!r} must be an integer from {low} to {high}")


def _number(name: str, value: object, unit: str, low: float, high: float) -> None:
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not number or not low < value <= high:  # type: ignore[operator]
        raise InputError(f"{name} {value!r}{unit} must be a number in ({low:g}, {high:g}]{unit}")
