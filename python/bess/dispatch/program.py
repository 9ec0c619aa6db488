"""A mixed-integer linear program in the form that HiGHS takes, and the one restriction dispatch needs."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import sparse

from bess.arrays import Array
from bess.dispatch.silence import stdout_to_stderr
from bess.errors import BessError

_GAP: Final = 1e-4
"""Relative gap at which the search over binaries stops."""


@dataclass(frozen=True)
class Program:
    """Minimise ``cost @ x`` subject to ``lower <= x <= upper`` and ``least <= rows @ x <= most``.

    The last `binaries` variables are 0 or 1.
    """

    cost: Array
    lower: Array
    upper: Array
    rows: sparse.csr_array
    least: Array
    most: Array
    binaries: int = 0

    def optimum(self) -> Array:
        """Return an optimal point, the same for the same program; raise BessError if there is none.

        Raises
        ------
        BessError
            The program has no solution.
        """
        # Loaded here: it takes half a second, which runs without a market need not spend.
        from scipy.optimize import Bounds, LinearConstraint, milp

        integrality = np.zeros(self.cost.size, dtype=np.int64)
        integrality[self.cost.size - self.binaries :] = 1
        with stdout_to_stderr():
            answer = milp(
                self.cost,
                integrality=integrality,
                bounds=Bounds(self.lower, self.upper),
                constraints=LinearConstraint(self.rows, self.least, self.most),
                options={"mip_rel_gap": _GAP},
            )
        if answer.x is None:
            raise BessError(f"the dispatch program has no solution; HiGHS says: {answer.message}")
        return np.asarray(answer.x, dtype=np.float64)

    def exclusive(self, first: npt.NDArray[np.intp], second: npt.NDArray[np.intp]) -> "Program":
        """Let only one of each pair of variables be above 0, by a binary; both have the upper bound 1."""
        count, size = first.size, self.cost.size
        row, one, zero = np.arange(count), np.ones(count), np.zeros(count)
        cells = (
            np.r_[one, -one, one, one],
            (np.r_[row, row, count + row, count + row], np.r_[first, size + row, second, size + row]),
        )
        pairs = sparse.csr_array(cells, shape=(2 * count, size + count))
        wider = sparse.hstack([self.rows, sparse.csr_array((self.least.size, count))])
        return Program(
            np.r_[self.cost, zero],
            np.r_[self.lower, zero],
            np.r_[self.upper, one],
            sparse.vstack([wider, pairs], format="csr"),
            np.r_[self.least, np.full(2 * count, -np.inf)],
            np.r_[self.most, zero, one],
            self.binaries + count,
        )
