"""Conversion of plant arguments to arrays of the core; errors of the core become :class:`InputError`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess.arrays import number_array
from bess.errors import InputError


@contextmanager
def refusals() -> Iterator[None]:
    """Convert errors of the core to :class:`InputError`.

    Raises
    ------
    InputError
        Replaces a ``ValueError`` of the core.
    """
    try:
        yield
    except ValueError as error:
        raise InputError(f"plant: {error}") from error


def numbers(name: str, values: ArrayLike, shape: tuple[int | str, ...], unit: str) -> NDArray[np.float64]:
    """Return ``values`` as float64 of the given shape; a string in the shape represents any length.

    Raises
    ------
    InputError
        The values are not numbers or have another shape.
    """
    array = number_array(f"plant: {name} [{unit}]", values)
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
    """Return one number; raise InputError for any other value."""
    return float(numbers(name, value, (), unit))


def ambient(values: ArrayLike | None, default_c: float, scenarios: int, steps: int) -> NDArray[np.float64]:
    """Return the air inlet temperature [degC], shape ``(steps, scenarios)``.

    ``values`` is one value, one per step, or ``(scenarios, steps)``.
    """
    if values is None or isinstance(values, float):
        return np.full((steps, scenarios), default_c if values is None else values)
    array = number_array("plant: ambient_c [degC]", values)
    if array.ndim == 2:
        return numbers("ambient_c", array, (scenarios, steps), "degC").T
    if array.ndim == 1:
        return np.repeat(numbers("ambient_c", array, (steps,), "degC")[:, None], scenarios, axis=1)
    return np.full((steps, scenarios), numbers("ambient_c", array, (), "degC"))
