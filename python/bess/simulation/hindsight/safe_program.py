"""A conic program whose bound holds for any accuracy of its solver."""

from __future__ import annotations

from typing import Any

import clarabel
import numpy as np
from scipy import sparse

from bess.dispatch.program import Columns, LinearProgram


class Program(LinearProgram):
    """A program of linear rows and cones with variables in ``[0, upper]``: a lower bound on its optimum."""

    def __init__(self) -> None:
        super().__init__()
        self._cone_rows: list[Columns] = []

    def at_most_product(
        self, root: tuple[Columns, Any], first: tuple[Columns, Any], *second: tuple[Columns, Any]
    ) -> None:
        """Require ``root^2 <= first * second`` in each step, all of them sums as in :meth:`at_most`.

        ``first`` and ``second``, with terms of one column a step, are not negative. The rows are those of
        the second-order cone ``|(first - second, 2 root)| <= first + second``.
        """
        columns, value = root
        cone = 3 * np.arange(len(columns))
        begin = sum(each.size for each in self._limits)
        self._cone_rows.append(np.arange(begin, begin + 3 * cone.size))
        terms = [(each, -factor, cone) for each, factor in (first, *second)]
        terms += [(first[0], -first[1], cone + 1), *((each, factor, cone + 1) for each, factor in second)]
        terms.append((columns, -2.0 * value, cone[:, None] + 2))
        self.at_most(np.zeros(3 * cone.size), *terms)

    def lower_bound(self) -> float:
        """Return a lower bound on the optimum, valid for any accuracy of the solver.

        For multipliers ``y`` of the rows, those of linear rows ``>= 0`` and those of a cone within it, every
        feasible point costs at least ``-y @ row_limits + sum_j min(0, (cost + y @ rows)_j upper_j)``.
        """
        cost, _, upper = self.data()
        cells, row_limits = self.rows()
        cones = np.concatenate([np.zeros(0, dtype=np.int64), *self._cone_rows])
        order = np.concatenate([np.setdiff1d(np.arange(row_limits.size), cones), cones])
        rows, row_limits, size = cells.tocsr()[order], row_limits[order], cost.size
        unit = sparse.eye_array(size, format="csr")
        every = sparse.csc_matrix(sparse.vstack([unit, -unit, rows]))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        # The bound is valid for any multipliers; these make it tight.
        settings.tol_gap_rel = 1e-6
        settings.max_threads = 1
        linear = row_limits.size - cones.size
        answer = clarabel.DefaultSolver(
            sparse.csc_matrix((size, size)),
            cost,
            every,
            np.concatenate([upper, np.zeros(size), row_limits]),
            [
                clarabel.NonnegativeConeT(2 * size + linear),
                *[clarabel.SecondOrderConeT(3)] * (cones.size // 3),
            ],
            settings,
        ).solve()
        multiplier = np.array(answer.z)[2 * size :]
        if not np.isfinite(multiplier).all():
            multiplier[:] = 0.0
        multiplier[:linear] = np.maximum(multiplier[:linear], 0.0)
        in_cone = multiplier[linear:].reshape(-1, 3)
        in_cone[:, 0] = np.maximum(in_cone[:, 0], np.hypot(in_cone[:, 1], in_cone[:, 2]))
        reduced = cost + rows.T @ multiplier
        return float(np.minimum(reduced * upper, 0.0).sum() - multiplier @ row_limits)
