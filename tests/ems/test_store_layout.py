"""Claims about where the quantities of a dispatch program stand in its matrix."""

import numpy as np
import pytest
from scipy import sparse

from bess.ems.store_layout import layout_of

DAY = np.array([3, 3, 4, 4, 4])
SIZES = (3, 2, 2, 2, 1, 2)
"""Pieces in charge and discharge, banks, tangents, lines of the voltage limits in each direction."""


@pytest.fixture
def values() -> list[np.ndarray]:
    """Random values of all cells, group by group."""
    random = np.random.default_rng(1)
    return [random.uniform(0.5, 2.0, shape) for *_, shape in layout_of(SIZES, DAY).groups]


def matrix(values: list[np.ndarray]) -> np.ndarray:
    at = layout_of(SIZES, DAY)
    compressed = (at.ordered(values), at.indices, at.starts)
    return np.asarray(sparse.csc_array(compressed, shape=(at.n_rows, at.n_columns)).toarray())


def test_every_value_stands_in_its_cell(values: list[np.ndarray]) -> None:
    at = layout_of(SIZES, DAY)
    dense = np.zeros((at.n_rows, at.n_columns))
    for (rows, columns), group in zip(at.cells, values, strict=True):
        assert not dense[rows, columns].any(), "no cell has two values"
        dense[rows, columns] = group
    np.testing.assert_array_equal(matrix(values), dense)


def test_what_is_basic_at_rest_is_a_basis(values: list[np.ndarray]) -> None:
    columns, rows = layout_of(SIZES, DAY).of_rest()
    basis = np.concatenate([matrix(values)[:, columns], np.eye(rows.size)[:, rows]], axis=1)
    assert basis.shape == (rows.size, rows.size)
    assert np.linalg.cond(basis) < 1e6


def test_plans_of_other_days_in_the_same_pattern_share_a_layout() -> None:
    assert layout_of(SIZES, DAY) is layout_of(SIZES, DAY + 7)
    assert layout_of(SIZES, DAY) is not layout_of(SIZES, np.zeros_like(DAY))
