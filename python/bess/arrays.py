"""Validation of numeric input arrays: type, finiteness, shape and range."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.errors import InputError
from bess.units import SECONDS_PER_HOUR

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class ByValue:
    """Base of frozen dataclasses with array fields: equal if all fields are, NaN included; not hashable.

    The generated comparison of ``dataclass`` fails for arrays, which have no truth value.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        assert is_dataclass(self)
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self) if f.compare)

    __hash__ = None  # type: ignore[assignment]


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")
    if isinstance(one, float) and isinstance(other, float) and np.isnan(one):
        return bool(np.isnan(other))
    return type(one) is type(other) and one == other


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view of an array that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def real_numbers(values: ArrayLike) -> Array:
    """Return ``values`` as float64, of any shape; NaN and infinity pass.

    Raises
    ------
    ValueError
        For texts, truth values, complex numbers, times, masked values, integers beyond the range of floats,
        and lists of unequal length. NumPy would convert them silently, or raise another exception.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise ValueError("some values are masked")
    array = np.asarray(values)
    if array.dtype == np.float64:
        return array
    if array.dtype.kind in "iuf":
        with np.errstate(over="ignore"):  # a long double above the range becomes infinity, as 1e400 does
            return array.astype(np.float64)
    if array.dtype.kind == "O":
        return np.array([_real(value) for value in array.ravel()], dtype=np.float64).reshape(array.shape)
    if array.size == 0:
        return array.astype(np.float64)
    kinds = {"U": "texts", "S": "texts", "b": "truth values", "c": "complex numbers", "M": "times"}
    raise ValueError(f"{kinds.get(array.dtype.kind, array.dtype)} are not numbers")


def _real(value: object) -> float:
    if isinstance(value, bool | str | bytes | complex) or value is None:
        raise ValueError(f"{type(value).__name__} is not a number")
    try:
        return float(value)  # type: ignore[arg-type]
    except OverflowError:
        raise ValueError("an integer is beyond the range of floating-point numbers") from None
    except TypeError:
        raise ValueError(f"{type(value).__name__} is not a number") from None


def number_array(name: str, values: ArrayLike) -> Array:
    """Return ``values`` as float64."""
    try:
        return real_numbers(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers ({error})") from error


def finite_array(name: str, values: ArrayLike) -> Array:
    """Return ``values`` as float64, all of them finite."""
    array = number_array(name, values)
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        place = f" at index {index if len(index) > 1 else index[0]}" if index else ""
        raise InputError(f"{name}{place} is {array[index]}; every value must be finite")
    return array


def step_of_times(name: str, values: Any, axis: int = -1) -> float | None:
    """Return the step [h] of the times along an axis of pandas or xarray data; None for fewer than two times.

    Numbers are no times. Other labels, such as times read as texts, are refused, as are times along another
    axis.
    """
    labels = getattr(values, "axes", None)  # of pandas
    if hasattr(values, "indexes") and hasattr(values, "dims"):  # of xarray
        labels = [values.indexes.get(dim) for dim in values.dims]
    if not isinstance(labels, list) or not labels:
        return None
    index = labels.pop(axis)
    if any(map(_are_times, labels)):
        raise InputError(f"{name}: times are along the wrong axis; transpose it")
    if not _are_times(index):
        if index is None or index.dtype.kind in "iuf":
            return None
        raise InputError(f"{name}: labels such as {index[0]!r:.60} are no times; see pandas.to_datetime")
    if len(index) < 2:
        return None
    times = index.to_timestamp() if hasattr(index, "to_timestamp") else index
    hours = np.diff(times.as_unit("ns").asi8) / (1e9 * SECONDS_PER_HOUR)
    if not (hours[0] > 0.0 and np.all(hours == hours[0])):
        raise InputError(
            f"{name}: times are {hours.min():g} to {hours.max():g} h apart; give one value for each step, "
            "in order"
        )
    return float(hours[0])


def _are_times(index: Any) -> bool:
    """Whether an index of pandas holds times, time differences or periods."""
    return index is not None and (index.dtype.kind in "mM" or hasattr(index, "to_timestamp"))


def check_times(name: str, values: object, dt_h: float, axis: int = -1) -> None:
    """Raise InputError unless the times along an axis of pandas or xarray data, if any, are a step apart."""
    step_h = step_of_times(name, values, axis)
    if step_h is not None and not np.isclose(step_h, dt_h):
        raise InputError(f"{name}: times are {step_h:g} h apart, but a step (dt_h, step_s) lasts {dt_h:g} h")


def step_hours(dt_h: ArrayLike) -> float:
    """Return the length of a step [h], at most a day."""
    hours = one_number("dt_h", dt_h)
    if not 0.0 < hours <= 24.0:
        raise InputError(f"dt_h {hours:g} h must be a number in (0, 24] h")
    return hours


def each_step(
    name: str, values: ArrayLike, n_steps: int, dt_h: float, limits: tuple[float, float], unit: str
) -> Array:
    """Return one finite value for each step within limits, from a scalar or one value for each step."""
    array = finite_array(name, values)
    if array.shape not in ((), (n_steps,)):
        raise InputError(
            f"{name} has shape {array.shape}; give one value, or one for each of {n_steps} steps"
        )
    check_times(name, values, dt_h)
    low, high = limits
    if array.min() < low or array.max() > high:
        worst = array.ravel()[np.argmax(np.abs(array))]
        raise InputError(f"{name} {worst:g} {unit} is outside [{low:g}, {high:g}] {unit}")
    return array if array.ndim else np.full(n_steps, array)


def one_number(name: str, value: ArrayLike) -> float:
    """Return one finite number."""
    array = finite_array(name, value)
    if array.ndim:
        raise InputError(f"{name} has shape {array.shape}; give one number")
    return float(array)


def whole_number(name: str, value: object, least: int) -> int:
    """Return a whole number, also one of NumPy, that is at least ``least``."""
    if not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{name} = {value!r}: must be a whole number, at least {least}")
    return int(value)


def require_positive(place: str, **values: tuple[float | None, str]) -> None:
    """Raise InputError unless all values are finite and positive; each has a unit; None is accepted."""
    for name, (value, unit) in values.items():
        if value is None:
            continue
        number = number_array(f"{place}: {name}", value)
        if number.ndim or not (np.isfinite(number) and number > 0.0):
            raise InputError(f"{place}: {name} {value}{unit} must be finite and above 0{unit}")
