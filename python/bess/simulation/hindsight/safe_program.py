"""A linear program whose bound holds for any accuracy of its solver."""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse

from bess.dispatch.program import LinearProgram


class Program(LinearProgram):
    """A linear program with variables in ``[0, upper]`` and a lower bound on its optimum."""

    def lower_bound(self) -> float:
        """Return a lower bound on the optimum, valid for any accuracy of the solver.

        For row multipliers ``y >= 0``, every feasible point costs at least
        ``-y @ row_limits + sum_j min(0, (cost + y @ rows)_j upper_j)``.
        """
        cost, _, upper = self.data()
        cells, row_limits = self.rows()
        rows, size = cells.tocsc(), cost.size
        unit = sparse.eye_array(size, format="csc")
        every = sparse.csc_matrix(sparse.vstack([rows, unit, -unit], format="csc"))
        limits = np.concatenate([row_limits, upper, np.zeros(size)])
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        # The bound is valid for any multipliers; these make it tight.
        settings.tol_gap_rel = 1e-6
        settings.max_threads = 1
        answer = clarabel.DefaultSolver(
            sparse.csc_matrix((size, size)),
            cost,
            every,
            limits,
            [clarabel.NonnegativeConeT(limits.size)],
            settings,
        ).solve()
        multiplier = np.maximum(np.array(answer.z)[: row_limits.size], 0.0)
        if not np.isfinite(multiplier).all():
            multiplier = np.zeros(row_limits.size)
        reduced = cost + rows.T @ multiplier
        return float(np.minimum(reduced * upper, 0.0).sum() - multiplier @ row_limits)
