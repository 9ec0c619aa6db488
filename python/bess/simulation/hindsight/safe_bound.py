"""Linear programs with a safe dual bound: valid for any multipliers, whatever the solver accuracy."""

from __future__ import annotations

from dataclasses import dataclass, field

import clarabel
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from bess.arrays import Array

Indices = NDArray[np.intp]


@dataclass
class Program:
    """Minimise ``cost @ x`` subject to ``rows @ x <= most`` and ``0 <= x <= upper``; built incrementally."""

    cost: list[Array] = field(default_factory=list)
    upper: list[Array] = field(default_factory=list)
    _size: int = 0
    _count: int = 0
    _row: list[Indices] = field(default_factory=list)
    _column: list[Indices] = field(default_factory=list)
    _value: list[Array] = field(default_factory=list)
    _most: list[Array] = field(default_factory=list)

    def variables(self, shape: tuple[int, ...], upper: ArrayLike, cost: ArrayLike = 0.0) -> Indices:
        """Add variables in ``[0, upper]``; return their indices in ``shape``."""
        count = int(np.prod(shape))
        self.upper.append(np.broadcast_to(np.asarray(upper, dtype=np.float64), shape).ravel())
        self.cost.append(np.broadcast_to(np.asarray(cost, dtype=np.float64), shape).ravel())
        numbers = self._size + np.arange(count).reshape(shape)
        self._size += count
        return numbers

    def at_most(self, most: ArrayLike, *terms: tuple[Indices, ArrayLike]) -> None:
        """Add rows ``sum of factor * variable <= most``; all arrays broadcast to the shape of the rows.

        A term whose variables have one more axis at the end is summed over it.
        """
        most = np.asarray(most, dtype=np.float64)
        rows = self._count + np.arange(most.size).reshape(most.shape)
        for numbers, factor in terms:
            own = rows if numbers.ndim == rows.ndim else rows[..., None]
            shape = np.broadcast_shapes(own.shape, numbers.shape)
            self._row.append(np.broadcast_to(own, shape).ravel())
            self._column.append(np.broadcast_to(numbers, shape).ravel())
            self._value.append(np.broadcast_to(np.asarray(factor, dtype=np.float64), shape).ravel())
        self._most.append(most.ravel())
        self._count += most.size

    def lower_bound(self) -> float:
        """Return a lower bound on the optimum, valid for any accuracy of the solver.

        For row multipliers ``y >= 0``, every feasible point costs at least
        ``-y @ most + sum_j min(0, (cost + y @ rows)_j upper_j)``.
        """
        cost, upper, most = (np.concatenate(parts) for parts in (self.cost, self.upper, self._most))
        cells = (np.concatenate(self._value), (np.concatenate(self._row), np.concatenate(self._column)))
        rows = sparse.csc_array(cells, shape=(self._count, self._size))
        unit = sparse.eye_array(self._size, format="csc")
        every = sparse.csc_matrix(sparse.vstack([rows, unit, -unit], format="csc"))
        limits = np.concatenate([most, upper, np.zeros(self._size)])
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        # The bound is valid for any multipliers; these make it tight.
        settings.tol_gap_rel = 1e-6
        settings.max_threads = 1
        answer = clarabel.DefaultSolver(
            sparse.csc_matrix((self._size, self._size)),
            cost,
            every,
            limits,
            [clarabel.NonnegativeConeT(limits.size)],
            settings,
        ).solve()
        multiplier = np.maximum(np.array(answer.z)[: self._count], 0.0)
        if not np.isfinite(multiplier).all():
            multiplier = np.zeros(self._count)
        reduced = cost + rows.T @ multiplier
        return float(np.minimum(reduced * upper, 0.0).sum() - multiplier @ most)
