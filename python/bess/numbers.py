"""What counts as an array of numbers when it comes from outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def real_numbers(values: ArrayLike) -> NDArray[np.float64]:
    """Return ``values`` as float64, of any shape; NaN and infinity pass.

    Raises
    ------
    ValueError
        For texts, truth values, complex numbers, times, masked values, integers beyond the range of floats,
        and lists of unequal length. They would be converted without a word, or end in another exception.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise ValueError("some values are masked")
    array = np.asarray(values)
    if array.dtype.kind in "iuf":
        return array.astype(np.float64, copy=False)
    if array.dtype.kind == "O":
        return np.array([_real(value) for value in array.ravel()], dtype=np.float64).reshape(array.shape)
    if array.size == 0:
        return array.astype(np.float64)
    raise ValueError(f"{_KINDS.get(array.dtype.kind, str(array.dtype))} are not numbers")


_KINDS = {
    "U": "texts",
    "S": "texts",
    "b": "truth values",
    "c": "complex numbers",
    "M": "times",
    "m": "durations",
}


def _real(value: object) -> float:
    if isinstance(value, bool | str | bytes | complex) or value is None:
        raise ValueError(f"{type(value).__name__} is not a number")
    try:
        return float(value)  # type: ignore[arg-type]
    except OverflowError:
        raise ValueError("an integer is beyond the range of floating-point numbers") from None
    except TypeError:
        raise ValueError(f"{type(value).__name__} is not a number") from None
