"""Where the quantities of a store program stand in its matrix, and what is basic when nothing is done."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from bess.numbers import Array

Places = npt.NDArray[np.int64]
Sizes = tuple[int, int, int, int, int, int]


class Layout:
    """Numbers of the columns and rows of a program of ``n`` blocks.

    Attributes
    ----------
    c, d : ndarray, shape (n, n_pieces)
        Columns of charging and discharging.
    g, y, e : ndarray, shape (n, n_banks)
        Columns of what enters, leaves and is in each bank.
    tau, q : ndarray, shape (n, 1)
        Columns of temperature and curtailed power.
    into, out, heat, limit : ndarray, shape (n, 1)
        Rows of what is charged and discharged, of the temperature and of the power.
    balance : ndarray, shape (n, n_banks)
        Rows of the energy of each bank.
    curtail : ndarray, shape (n, n_tangents)
        Rows of derating.
    taper_c, taper_d : ndarray, shape (n, n_lines)
        Rows of the voltage limits in charge and in discharge.
    cycle : ndarray, shape (n_days,)
        Rows of the cycles of each day.
    throughput : int
        Row of the energy of the whole plan; the last one.
    cells : list of (rows, columns)
        Cells that are not 0, in groups that broadcast.
    """

    def __init__(self, sizes: Sizes, day: Places):
        n_charge, n_discharge, n_banks, n_tangents, n_lines_c, n_lines_d = sizes
        n = day.size
        ends = np.cumsum([0, n_charge, n_discharge, n_banks, n_banks, n_banks, 1, 1])
        first = ends[-1] * np.arange(n)[:, None]
        self.c, self.d, self.g, self.y, self.e, self.tau, self.q = (
            first + np.arange(low, high) for low, high in pairwise(ends)
        )
        self.n_columns = int(ends[-1]) * n
        ends = np.cumsum([0, 1, 1, 1, 1, n_banks, n_tangents, n_lines_c, n_lines_d])
        first = ends[-1] * np.arange(n)[:, None]
        (
            self.into, self.out, self.heat, self.limit,
            self.balance, self.curtail, self.taper_c, self.taper_d,
        ) = (first + np.arange(low, high) for low, high in pairwise(ends))  # fmt: skip
        self.cycle = int(ends[-1]) * n + np.arange(day[-1] - day[0] + 1)
        self.throughput = int(self.cycle[-1]) + 1
        self.n_rows = self.throughput + 1
        self.cells: list[tuple[Any, Places]] = [
            (self.into, self.g), (self.out, self.y),
            (self.balance, self.e), (self.balance[1:], self.e[:-1]),
            (self.balance, self.g), (self.balance, self.y),
            (self.heat, self.tau), (self.heat[1:], self.tau[:-1]), (self.heat, self.g), (self.heat, self.y),
            (self.limit, self.c), (self.limit, self.d), (self.limit, self.q), (self.curtail, self.q),
            (self.cycle[day - day[0]][:, None], self.y),
            (self.throughput, self.c), (self.throughput, self.d),
            (self.into, self.c), (self.out, self.d), (self.heat, self.c), (self.heat, self.d),
            (self.curtail, self.tau), (self.curtail[1:], self.tau[:-1]),
            *(
                (rows[:, :, None], columns[:, None, :])
                for taper, power in ((self.taper_c, self.c), (self.taper_d, self.d))
                for rows, columns in ((taper, power), (taper, self.e), (taper[1:], self.e[:-1]))
            ),
        ]  # fmt: skip
        cells = [np.broadcast_arrays(*cell) for cell in self.cells]
        ends = np.cumsum([0, *(rows.size for rows, _ in cells)])
        self.groups = [
            (int(first), int(last), rows.shape)
            for (first, last), (rows, _) in zip(pairwise(ends), cells, strict=True)
        ]
        rows, columns = (np.concatenate([cell[i].ravel() for cell in cells]) for i in range(2))
        # The numbers of the cells as data: what the conversion sorts is where each belongs.
        numbered = sparse.csc_array(
            (np.arange(1.0, rows.size + 1.0), (rows, columns)), shape=(self.n_rows, self.n_columns)
        )
        self._order = numbered.data.astype(np.int64) - 1
        self.starts, self.indices = (part.astype(np.int32) for part in (numbered.indptr, numbered.indices))

    def ordered(self, values: list[Any]) -> Array:
        """Values of :attr:`cells`, group by group, in the order of the compressed columns."""
        flat = np.empty(self._order.size)
        for part, (first, last, shape) in zip(values, self.groups, strict=True):
            flat[first:last].reshape(shape)[...] = part
        return flat[self._order]

    def of_rest(self) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Columns and rows that are basic when nothing is done: banks keep their energy, the plant cools."""
        columns, rows = np.zeros(self.n_columns, dtype=bool), np.ones(self.n_rows, dtype=bool)
        for basic in (self.g[:, 0], self.y[:, 0], self.e, self.tau):
            columns[basic] = True
        for tight in (self.into, self.out, self.balance, self.heat):
            rows[tight] = False
        return columns, rows


def layout_of(sizes: Sizes, day: Places) -> Layout:
    """Return the layout for these sizes and the day of each block.

    The sizes are numbers of pieces in charge and in discharge, banks, tangents, and lines of the voltage
    limits in charge and in discharge.

    Plans of a run have few different ones, so the last few are kept.
    """
    return _layout(sizes, tuple(day - day[0]))


@lru_cache(maxsize=32)
def _layout(sizes: Sizes, day: tuple[int, ...]) -> Layout:
    return Layout(sizes, np.array(day))
