"""Linear programs by rows and columns, and that of one store: its energy balance, solved by HiGHS."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array
from bess.errors import BessError

if TYPE_CHECKING:
    from scipy import sparse

_GAP: Final = 1e-4
"""Relative gap at which the search over binaries stops."""

Columns = npt.NDArray[np.int64]


class LinearProgram:
    """Minimise ``cost @ x`` subject to ``rows @ x <= limits`` and bounds on ``x``; built incrementally."""

    def __init__(self) -> None:
        self._columns: list[Array] = []
        self._cells: list[Array] = []
        self._limits: list[Array] = []

    def add(
        self, shape: int | tuple[int, ...], *, cost: Any = 0.0, lower: Any = 0.0, upper: Any = np.inf
    ) -> Columns:
        """Add columns with their cost and bounds, and return their numbers in ``shape``."""
        first = sum(each.shape[1] for each in self._columns)
        columns = np.stack([np.broadcast_to(each, shape).ravel() for each in (cost, lower, upper)])
        self._columns.append(columns)
        return np.arange(first, first + columns.shape[1]).reshape(shape)

    def at_most(self, limit: npt.ArrayLike, *terms: tuple[Columns, Any] | tuple[Columns, Any, Any]) -> None:
        """Add rows: the sum of value x column over all terms is at most ``limit``.

        A term is columns and values that broadcast to the shape of the limits; if its columns have one more
        axis at the end, it is summed over this axis. Otherwise its third entry is the row (from 0) of each
        column.
        """
        limits = np.asarray(limit, dtype=np.float64)
        first = sum(each.size for each in self._limits)
        own = np.arange(limits.size).reshape(limits.shape)
        for columns, value, *given in terms:
            row = given[0] if given else own if columns.ndim == own.ndim else own[..., None]
            cell = np.broadcast_arrays(first + row, columns, value)
            self._cells.append(np.stack([np.ravel(each) for each in cell]).astype(np.float64))
        self._limits.append(limits.ravel())

    def data(self) -> tuple[Array, Array, Array]:
        """Return cost, lower and upper bound of the columns."""
        cost, lower, upper = np.concatenate(self._columns, axis=1)
        return cost, lower, upper

    def rows(self) -> tuple[sparse.coo_array, Array]:
        """Return the rows and their limits."""
        # Loaded here, because it takes half a second that runs without a market do not need.
        from scipy import sparse

        row, column, value = np.concatenate([np.zeros((3, 0)), *self._cells], axis=1)
        limits = np.concatenate([np.zeros(0), *self._limits])
        cells = value, (row.astype(np.int64), column.astype(np.int64))
        size = sum(each.shape[1] for each in self._columns)
        return sparse.coo_array(cells, shape=(limits.size, size)), limits


@dataclass(frozen=True)
class StoreSchedule:
    """An optimal schedule; powers and energies in the unit of the program."""

    cost: float
    """Optimal value of the objective."""
    charge: Array
    discharge: Array
    stored: Array
    """``(n_steps,)``: power of either direction (AC), and stored energy at the end of each step."""
    added: Array
    """Values of the columns that were added."""
    duals: Array
    """Decrease of the cost per unit of each added row; empty with binaries."""


class StoreProgram(LinearProgram):
    r"""Minimise the cost of a store's schedule.

    With charging :math:`c`, discharging :math:`d` (AC), stored energy :math:`e`, steps of :math:`T_t` hours
    and the efficiency :math:`\eta` of each direction,

    .. math:: \min \sum_t a_t c_t + b_t d_t + \dots\quad\text{s. t.}\quad
       e_t = e_{t-1} + \eta c_t T_t - d_t T_t / \eta .

    Further columns and rows are added to it (:meth:`add`, :meth:`at_most`). Energies have the
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
        super().__init__()
        self._hours, self._one_way_efficiency, self._initial = hours, one_way_efficiency, initial
        self._binaries = 0
        n = hours.size
        self.charge, self.discharge = (
            self.add(n, cost=each, upper=upper) for each, upper in zip(cost, max_power, strict=True)
        )
        self.stored = self.add(n, lower=min(0.0, initial), upper=max(capacity, initial))

    def forbid_both_directions(self, steps: npt.NDArray[np.int64]) -> None:
        """Let the store only charge or only discharge in each of these steps, by a binary."""
        max_charge, max_discharge = self._columns[0][2, steps], self._columns[1][2, steps]
        charges = self.add(steps.size, upper=1.0)
        self._binaries += steps.size
        self.at_most(0.0 * max_charge, (self.charge[steps], 1.0), (charges, -max_charge))
        self.at_most(max_discharge, (self.discharge[steps], 1.0), (charges, max_discharge))

    def solve(self) -> StoreSchedule:
        """Return an optimal schedule, the same for the same program."""
        from scipy import sparse
        from scipy.optimize import linprog

        cost, lower, upper = self.data()
        n, size = self._hours.size, cost.size
        step, one_way = np.arange(n), self._one_way_efficiency
        cells = (
            (step, self.charge, -one_way * self._hours),
            (step, self.discharge, self._hours / one_way),
            (step, self.stored, np.ones(n)),
            (step[1:], self.stored[:-1], -np.ones(n - 1)),
        )
        row, column, value = (np.concatenate(part) for part in zip(*cells, strict=True))
        rows, limits = self.rows()
        start = np.zeros(n)
        start[0] = self._initial
        with _stdout_to_stderr():
            answer = linprog(  # type: ignore[call-overload]  # stubs know no sparse rows
                cost,
                A_ub=rows.tocsr(),
                b_ub=limits,
                A_eq=sparse.csr_array((value, (row, column)), shape=(n, size)),
                b_eq=start,
                bounds=np.column_stack([lower, upper]),
                integrality=np.arange(size) >= size - self._binaries if self._binaries else None,
                method="highs",
                options={"mip_rel_gap": _GAP},
            )
        if answer.x is None:
            raise BessError(f"the dispatch program has no solution; HiGHS says: {answer.message}")
        charge, discharge, stored, added = np.split(np.asarray(answer.x), [n, 2 * n, 3 * n])
        duals = -np.asarray(answer.ineqlin.marginals)
        return StoreSchedule(float(answer.fun), charge, discharge, stored, added, duals)


_STDOUT = 1
_STDERR = 2
_stdout_lock = threading.Lock()
"""File descriptors are common to all threads."""


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Redirect the standard output of compiled code, which is reserved for results, to standard error.

    Some messages of HiGHS cannot be switched off. The C library buffers them; it is flushed before and after.
    """
    with _stdout_lock:
        try:
            saved = os.dup(_STDOUT)
        except OSError:  # no standard output
            yield
            return
        try:
            _flush()
            os.dup2(_STDERR, _STDOUT)
            yield
        finally:
            _flush()
            os.dup2(saved, _STDOUT)
            os.close(saved)


def _flush() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)
