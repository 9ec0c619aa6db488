"""Claim: the streaming count is that of the package ``rainflow`` (ASTM E1049-85), cycle by cycle."""

from __future__ import annotations

import numpy as np
import pytest
import rainflow
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bess import _core

pytestmark = pytest.mark.independent


def random_series(seed: int) -> NDArray[np.float64]:
    """Walks, noise, plateaus, coarse values with many ties, and runs to and from the same ends."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 400))
    kind = seed % 5
    if kind == 0:
        return rng.normal(size=n)
    if kind == 1:
        return np.cumsum(rng.normal(size=n))
    if kind == 2:
        return rng.integers(0, 6, size=n).astype(np.float64)
    if kind == 3:
        return np.repeat(np.cumsum(rng.integers(-2, 3, size=n)), rng.integers(1, 4, size=n)).astype(
            np.float64
        )
    return np.clip(0.5 + np.cumsum(rng.normal(scale=0.2, size=n)), 0.0, 1.0)


@pytest.mark.parametrize("block", range(10))
def test_a_thousand_random_series_are_counted_as_by_the_package(block: int) -> None:
    for seed in range(100 * block, 100 * block + 100):
        series = random_series(seed)
        assert _core.rainflow(series) == list(rainflow.extract_cycles(series)), seed


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3).map(lambda x: round(x, 2)), min_size=3, max_size=60))
def test_any_series_is_counted_as_by_the_package(values: list[float]) -> None:
    series = np.array(values)
    # Of a series that never moves the package makes half a cycle of no range.
    expected = [cycle for cycle in rainflow.extract_cycles(series) if cycle[0] > 0.0]
    assert _core.rainflow(series) == expected
