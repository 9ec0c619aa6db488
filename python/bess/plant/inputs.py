"""Arguments of the plant to arrays the core takes; everything it refuses becomes an :class:`InputError`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.errors import InputError
from bess.numbers import real_numbers


@contextmanager
def refusals() -> Iterator[None]:
    """Turn what the core refuses into an :class:`InputError`.

    Raises
    ------
    InputError
        In place of a ``ValueError`` of the core.
    """
    try:
        yield
    except ValueError as error:
        raise InputError(f"plant: {error}") from error


def numbers(name: str, values: ArrayLike, shape: tuple[int | str, ...], unit: str) -> NDArray[np.float64]:
    """Return ``values`` as float64 of the given shape, in which a text stands for any length.

    Raises
    ------
    InputError
        If they are no numbers or have another shape.
    """
    array = any_shape(name, values, unit)
    fits = array.shape == shape or (
        array.ndim == len(shape)
        and all(isinstance(want, str) or have == want for have, want in zip(array.shape, shape, strict=True))
    )
    if not fits:
        if shape == ():
            raise InputError(f"plant: {name} [{unit}] has shape {array.shape}; give one number")
        wanted = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise InputError(f"plant: {name} [{unit}] has shape {array.shape}, needs ({wanted})")
    return array


def one_number(name: str, value: ArrayLike, unit: str) -> float:
    """Return one number; raise InputError if it is none, or several."""
    return float(numbers(name, value, (), unit))


def any_shape(name: str, values: ArrayLike, unit: str) -> NDArray[np.float64]:
    """Return ``values`` as float64; raise InputError if they are no numbers.

    Raises
    ------
    InputError
        They are no numbers.
    """
    try:
        return real_numbers(values)
    except ValueError as error:
        raise InputError(f"plant: {name}: needs numbers [{unit}] ({error})") from error


def ambient(values: ArrayLike | None, default_c: float, scenarios: int, steps: int) -> NDArray[np.float64]:
    """Return the air inlet temperature [degC], shape ``(steps, scenarios)``.

    ``values`` is one value, one per step, or ``(scenarios, steps)``.
    """
    if values is None or isinstance(values, float):
        return np.full((steps, scenarios), default_c if values is None else values)
    array = any_shape("ambient_c", values, "degC")
    if array.ndim == 2:
        return numbers("ambient_c", array, (scenarios, steps), "degC").T
    if array.ndim == 1:
        return np.repeat(numbers("ambient_c", array, (steps,), "degC")[:, None], scenarios, axis=1)
    return np.full((steps, scenarios), numbers("ambient_c", array, (), "degC"))
