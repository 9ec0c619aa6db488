"""The linear program of one store: its energy balance, and the rows and columns that a dispatch adds."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array
from bess.dispatch.silence import stdout_to_stderr
from bess.errors import BessError

_GAP: Final = 1e-4
"""Relative gap at which the search over binaries stops."""

Columns = npt.NDArray[np.int64]


@dataclass(frozen=True)
class StoreSchedule:
    """An optimal schedule; powers and energies in the unit of the program.

    Attributes
    ----------
    cost : float
        Optimal value of the objective.
    charge, discharge, stored : ndarray, shape (n_steps,)
        Power of either direction (AC), and stored energy at the end of each step.
    added : ndarray
        Values of the columns that were added.
    duals : ndarray
        Decrease of the cost per unit of each added row; empty with binaries.
    """

    cost: float
    charge: Array
    discharge: Array
    stored: Array
    added: Array
    duals: Array


class StoreProgram:
    r"""Minimise the cost of a store's schedule.

    With charging :math:`c`, discharging :math:`d` (AC), stored energy :math:`e`, steps of :math:`T_t` hours
    and the efficiency :math:`\eta` of each direction,

    .. math:: \min \sum_t a_t c_t + b_t d_t + \dots\quad\text{s. t.}\quad
       e_t = e_{t-1} + \eta c_t T_t - d_t T_t / \eta .

    Columns and rows are added to it (:meth:`add`, :meth:`at_most`). Energies have the
    unit of powers times 1 h; values near 1 suit the tolerance of the solver (1e-7).

    Parameters
    ----------
    hours : ndarray, shape (n_steps,)
        Length of each step.
    one_way_efficiency : float
        Efficiency of each direction.
    initial : float
        Energy at the start. A value outside the limits is accepted and not moved further outside.
    cost, max_power : pair of float or array
        Cost and maximum power of charging and of discharging.
    capacity : float
        Maximum stored energy; the minimum is 0.
    """

    def __init__(
        self,
        hours: Array,
        one_way_efficiency: float,
        initial: float,
        *,
        cost: tuple[Any, Any],
        max_power: tuple[Any, Any],
        capacity: float,
    ):
        self._hours, self._one_way_efficiency, self._initial = hours, one_way_efficiency, initial
        self._columns: list[Array] = []
        self._cells: list[Array] = []
        self._limits: list[Array] = []
        self._binaries = 0
        n = hours.size
        self.charge, self.discharge = (
            self.add(n, cost=each, upper=upper) for each, upper in zip(cost, max_power, strict=True)
        )
        self.stored = self.add(n, lower=min(0.0, initial), upper=max(capacity, initial))

    def add(self, count: int, *, cost: Any = 0.0, lower: Any = 0.0, upper: Any = np.inf) -> Columns:
        """Add columns with their cost and bounds, and return their numbers."""
        first = sum(each.shape[1] for each in self._columns)
        self._columns.append(np.stack([np.broadcast_to(each, count) for each in (cost, lower, upper)]))
        return np.arange(first, first + count)

    def at_most(self, limit: npt.ArrayLike, *cells: tuple[Any, Any, Any]) -> None:
        """Add rows: the sum of value times column, over the cells of each, is at most ``limit``.

        A cell is a row (from 0), a column and a value, or arrays of them, broadcast against each other.
        """
        first = sum(each.size for each in self._limits)
        for row, column, value in cells:
            cell = np.broadcast_arrays(np.add(first, row), column, value)
            self._cells.append(np.stack([np.ravel(each) for each in cell]).astype(np.float64))
        self._limits.append(np.atleast_1d(np.asarray(limit, dtype=np.float64)))

    def forbid_both_directions(self, steps: npt.NDArray[np.int64]) -> None:
        """Let the store only charge or only discharge in each of these steps, by a binary."""
        max_charge, max_discharge = self._columns[0][2, steps], self._columns[1][2, steps]
        row = np.arange(steps.size)
        charges = self.add(steps.size, upper=1.0)
        self._binaries += steps.size
        self.at_most(0.0 * max_charge, (row, self.charge[steps], 1.0), (row, charges, -max_charge))
        self.at_most(max_discharge, (row, self.discharge[steps], 1.0), (row, charges, max_discharge))

    def solve(self) -> StoreSchedule:
        """Return an optimal schedule, the same for the same program.

        Raises
        ------
        BessError
            The program has no solution.
        """
        # Loaded here, because it takes half a second that runs without a market do not need.
        from scipy import sparse
        from scipy.optimize import linprog

        cost, lower, upper = np.concatenate(self._columns, axis=1)
        n, size = self._hours.size, cost.size
        length, change = sparse.diags_array(self._hours), sparse.eye_array(n) - sparse.eye_array(n, k=-1)
        balance = [
            -self._one_way_efficiency * length,
            length / self._one_way_efficiency,
            change,
            sparse.csr_array((n, size - 3 * n)),
        ]
        rows = {}
        if self._limits:
            row, column, value = np.concatenate(self._cells, axis=1)
            limits = np.concatenate(self._limits)
            cells = value, (row.astype(np.int64), column.astype(np.int64))
            rows = {"A_ub": sparse.csr_array(cells, shape=(limits.size, size)), "b_ub": limits}
        start = np.zeros(n)
        start[0] = self._initial
        with stdout_to_stderr():
            answer = linprog(  # type: ignore[call-overload]  # stubs know no sparse rows
                cost,
                **rows,
                A_eq=sparse.hstack(balance, format="csr"),
                b_eq=start,
                bounds=np.column_stack([lower, upper]),
                integrality=np.arange(size) >= size - self._binaries if self._binaries else None,
                method="highs",
                options={"mip_rel_gap": _GAP},
            )
        if answer.x is None:
            raise BessError(f"the dispatch program has no solution; HiGHS says: {answer.message}")
        charge, discharge, stored, added = np.split(np.asarray(answer.x), [n, 2 * n, 3 * n])
        duals = -np.asarray(answer.ineqlin.marginals) if rows else np.zeros(0)
        return StoreSchedule(float(answer.fun), charge, discharge, stored, added, duals)
