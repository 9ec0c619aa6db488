"""The relaxation of one group as the tree sees it: nodes of the conic program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bess.numbers import Array
from bess.split.relaxation import conic
from bess.split.relaxation.conic import ConicData, ConicProgram, NodeStatus
from bess.split.tree import Bits, Node


@dataclass(frozen=True)
class KnownBefore:
    """What is known before any solve, each of shape ``(n_strings, n_steps)`` unless said otherwise.

    Attributes
    ----------
    may_run, may_shed, may_derate : ndarray of bool
    ordered : ndarray of bool, shape (n_strings - 1,)
        String ``m + 1`` is like string ``m`` in every respect, so that the two can be exchanged: in the first
        step it runs only if ``m`` does.
    soc, theta : ndarray, shape (n_strings,)
        Measured state, per unit.
    """

    may_run: NDArray[np.bool_]
    may_shed: NDArray[np.bool_]
    may_derate: NDArray[np.bool_]
    ordered: NDArray[np.bool_]
    soc: Array
    theta: Array


class RelaxedGroup:
    """Relaxation of one group; binaries are ``on`` then ``full``, each ``(n_strings, n_steps)`` row-major."""

    def __init__(
        self,
        program: ConicProgram,
        data: ConicData,
        known: KnownBefore,
        unit: float,
        objective: Callable[[], float],
        propose: Callable[[Array, Array], None],
    ) -> None:
        self._program, self._data, self._known, self._unit = program, data, known, unit
        self.incumbent, self._propose = objective, propose
        self.failures = 0
        self._index = {
            name: np.arange(s.start, s.stop).reshape(program.shapes[name], order="F")
            for name, s in program.slices.items()
        }
        self._fixed = np.zeros(program.n_columns, dtype=bool)
        self._values = np.zeros(program.n_columns)
        for name, value in (("soc", known.soc), ("theta", known.theta)):
            self._fixed[self._index[name][:, 0]] = True
            self._values[self._index[name][:, 0]] = value
        self._fixed[self._index["d"][~known.may_derate]] = True

    @property
    def n_binaries(self) -> int:
        """Two for each string and step."""
        return 2 * self._known.may_run.size

    def root(self) -> tuple[Bits, Bits]:
        """Bounds of the binaries before branching."""
        upper = np.concatenate([self._known.may_run.ravel(), self._known.may_shed.ravel()])
        return np.zeros(self.n_binaries, dtype=np.int8), upper.astype(np.int8)

    def solve(self, lower: Bits, upper: Bits) -> Node:
        """Solve one node; its bound is in the unit of the group's objective."""
        shape = (2, *self._known.may_run.shape)
        lo, up = lower.reshape(shape).copy(), upper.reshape(shape).copy()
        for m in np.flatnonzero(self._known.ordered):
            up[0, m + 1, 0] = min(up[0, m + 1, 0], up[0, m, 0])
        for m in np.flatnonzero(self._known.ordered)[::-1]:
            lo[0, m, 0] = max(lo[0, m, 0], lo[0, m + 1, 0])
        if np.any(lo > up):
            return Node(np.inf, None)
        fixed, values = self._fixed.copy(), self._values.copy()
        for binary, name, dependents in ((0, "on", ("p", "w", "h", "z", "P")), (1, "full", ("a",))):
            settled = lo[binary] == up[binary]
            fixed[self._index[name][settled]] = True
            values[self._index[name][settled]] = lo[binary][settled]
            for dependent in dependents:
                fixed[self._index[dependent][settled & (up[binary] == 0)]] = True
        answer = conic.solve(self._data, fixed, values)
        if answer.status is NodeStatus.UNKNOWN:
            self.failures += 1
        if answer.x is None:
            return Node(answer.bound * self._unit, None)
        on, full, p, a, d = (self._program.value(answer.x, name) for name in ("on", "full", "p", "a", "d"))
        self._propose(p + a + d, on)
        binaries = np.concatenate([on.ravel(), full.ravel()])
        return Node(answer.bound * self._unit, np.clip(binaries, 0.0, 1.0))
