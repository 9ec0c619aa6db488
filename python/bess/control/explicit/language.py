"""Python implementation of the types used by :mod:`bess.control.explicit.decision`."""

from __future__ import annotations

Floats = list[float]
"""An array of numbers of fixed size."""
Flags = list[bool]
"""An array of truth values of fixed size."""


def zeros(size: int) -> Floats:
    """Array of ``size`` zeros."""
    return [0.0] * size


def falses(size: int) -> Flags:
    """Array of ``size`` times False."""
    return [False] * size
