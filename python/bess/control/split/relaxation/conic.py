"""A CVXPY problem compiled once into an affine map from parameters to Clarabel data, and its nodes.

CVXPY is called once, for the tensors that map a parameter vector to ``(q, A, b)``. An update is then one
sparse product, and a node is one Clarabel call without CVXPY. Variables that a node fixes are removed with
the rows that become empty: equal lower and upper bounds leave no interior, a known cause of "insufficient
progress". Every node builds its own solver, so a solution depends on the node's data only.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bess.arrays import Array

if TYPE_CHECKING:
    import cvxpy as cp

FEASIBILITY_TOLERANCE = 1e-6
"""Largest violation of a row without free variables before the node counts as infeasible (per unit)."""

BOUND_MARGIN = 1e-6
"""Relative reduction of a dual objective, to cover the dual residual of Clarabel."""

MAX_VALUE = 200.0
"""Upper bound of all variables of the per-unit program; it limits the effect of a dual residual."""


@dataclass(frozen=True)
class ConicSolution:
    """Outcome of one node."""

    bound: float
    """Lower bound of its optimum; ``inf`` if certified infeasible, ``-inf`` if the solver failed."""
    x: Array | None = None
    prices: Array | None = None
    """Optimum, and shadow prices of all rows."""


@dataclass(frozen=True)
class Pattern:
    """Sparsity pattern of ``A`` by columns, and the rows of the zero and the nonnegative cone."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    n_zero: int
    n_nonneg: int


@dataclass(frozen=True)
class ConicData:
    """One instance ``min q'x + offset, A x + s = b, s in K``; ``K`` is zero, nonnegative, then 3-cones."""

    q: Array
    offset: float
    pattern: Pattern
    values: Array
    b: Array


class ConicProgram:
    """Affine map from named parameters to Clarabel data."""

    def __init__(
        self,
        problem: cp.Problem,
        variables: Mapping[str, cp.Variable],
        parameters: Mapping[str, cp.Parameter],
    ) -> None:
        for parameter in parameters.values():
            parameter.value = np.zeros(parameter.shape)
        data, _, _ = problem.get_problem_data("CLARABEL", solver_opts={})
        program, dims = data["param_prob"], data["dims"]
        if any(size != 3 for size in dims.soc) or dims.exp or dims.psd:
            raise ValueError("only rotated cones of three rows are expected")
        self.n_columns = program.x.size
        n_rows = program.constr_size
        self.slices = {
            name: slice(program.var_id_to_col[v.id], program.var_id_to_col[v.id] + v.size)
            for name, v in variables.items()
        }
        self.shapes = {name: v.shape for name, v in variables.items()}
        self.places = {
            name: program.param_id_to_col[p.id] + np.arange(p.size).reshape(p.shape, order="F")
            for name, p in parameters.items()
        }
        self._n_parameters = program.total_param_size

        # vec([A | b]), column-major, is affine in the parameters; rows of the tensor that are not empty are
        # the pattern. CVXPY keeps constraints as A x + b in K, Clarabel wants A x + s = b.
        tensor = sp.csr_array(program.A)
        used = np.flatnonzero(np.diff(tensor.indptr))
        entries = used[used < n_rows * self.n_columns]
        self._pattern = Pattern(entries % n_rows, entries // n_rows, dims.zero, dims.nonneg)
        self._a_map = -sp.csr_array(tensor[entries])
        self._b_map = sp.csr_array(tensor[n_rows * self.n_columns :])
        self._q_map = sp.csr_array(program.q)

    def repeated(self, n: int, shared: Collection[str], linked: str) -> ConicProgram:
        """Return the program of ``n`` strings from this program of one, in the order of a direct compilation.

        The memory of a direct compilation grows with the square of the number of strings.

        Parameters
        ----------
        n
            Number of strings: leading axis of all variables, and of all parameters that are not shared.
        shared
            Names of parameters common to all strings; rows with one of them on the right-hand side add up the
            entries of all strings.
        linked
            Name of the parameter whose rows also have the entries of the next string, negative.
        """
        constant = self._n_parameters
        is_shared = np.zeros(constant + 1, dtype=bool)
        for name in shared:
            is_shared[self.places[name]] = True
        entries, of_b, of_q = (sp.coo_array(map_) for map_ in (self._a_map, self._b_map, self._q_map))
        n_zero, cone_start = self._pattern.n_zero, self._pattern.n_zero + self._pattern.n_nonneg
        common = np.zeros(self._b_map.shape[0], dtype=bool)
        common[of_b.row[is_shared[of_b.col]]] = True
        first = np.concatenate([[0], np.cumsum(np.where(common, 1, n))])
        width = np.where(common, 0, 1)
        width[cone_start:] = 3
        cone = np.arange(common.size - cone_start)
        first[cone_start:-1] = first[cone_start] + cone // 3 * 3 * n + cone % 3

        def parameter(columns: NDArray[Any], string: int) -> NDArray[Any]:
            return n * columns + np.where(is_shared[columns] | (columns == constant), 0, string)

        def row(rows: NDArray[Any], string: int) -> NDArray[Any]:
            return np.asarray(first[rows] + width[rows] * string)

        # Position, parameter and value of the coefficients of A and of b.
        pattern, linking = self._pattern, np.isin(entries.col, self.places[linked])
        of_a, b_parts, q_parts = [], [], []
        for m in range(n):
            columns = parameter(entries.col, m)
            rows = row(pattern.rows[entries.row], m)
            of_a.append((n * pattern.columns[entries.row] + m, rows, columns, entries.data))
            if m + 1 < n:
                to = n * pattern.columns[entries.row[linking]] + m + 1
                of_a.append((to, rows[linking], columns[linking], -entries.data[linking]))
            once = ~common[of_b.row] if m else np.ones(of_b.row.size, dtype=bool)
            b_parts.append((row(of_b.row[once], m), parameter(of_b.col[once], m), of_b.data[once]))
            once = of_q.row < self.n_columns if m else np.ones(of_q.row.size, dtype=bool)
            at = np.where(of_q.row < self.n_columns, n * of_q.row + m, n * self.n_columns)[once]
            q_parts.append((at, parameter(of_q.col[once], m), of_q.data[once]))

        out = copy(self)
        out.n_columns, out._n_parameters = n * self.n_columns, n * constant
        out.slices = {name: slice(n * s.start, n * s.stop) for name, s in self.slices.items()}
        out.shapes = {name: (n, *shape[1:]) for name, shape in self.shapes.items()}
        out.places = {
            name: n * place
            if name in shared
            else n * place + np.arange(n).reshape(-1, *(1,) * (place.ndim - 1))
            for name, place in self.places.items()
        }
        columns, rows, theta, data = (np.concatenate(part) for part in zip(*of_a, strict=True))
        place, entry = np.unique(columns * first[-1] + rows, return_inverse=True)
        n_zero, cone_start = int(first[n_zero]), int(first[cone_start])
        out._pattern = Pattern(place % first[-1], place // first[-1], n_zero, cone_start - n_zero)
        width_theta = n * constant + 1
        out._a_map = sp.csr_array((data, (entry, theta)), shape=(place.size, width_theta))
        for name, parts, size in (("_b_map", b_parts, first[-1]), ("_q_map", q_parts, out.n_columns + 1)):
            rows, theta, data = (np.concatenate(part) for part in zip(*parts, strict=True))
            setattr(out, name, sp.csr_array((data, (rows, theta)), shape=(size, width_theta)))
        return out

    def parameters(self, values: Mapping[str, Array | float]) -> Array:
        """Return the parameter vector for :meth:`load`; other parameters are zero.

        ``places`` holds the position of each parameter in the vector.
        """
        theta = np.zeros(self._n_parameters + 1)
        theta[-1] = 1.0
        for name, value in values.items():
            theta[self.places[name]] = value
        return theta

    def load(self, theta: Array) -> ConicData:
        """Return the instance for a vector of parameters."""
        q = self._q_map @ theta
        return ConicData(q[:-1], float(q[-1]), self._pattern, self._a_map @ theta, self._b_map @ theta)

    def value(self, x: Array, name: str) -> Array:
        """Return the variable ``name`` at the point ``x``."""
        return x[self.slices[name]].reshape(self.shapes[name], order="F")


def solve(data: ConicData, fixed: NDArray[np.bool_], x_fixed: Array) -> ConicSolution:
    """Solve an instance with the variables ``fixed`` held at ``x_fixed``.

    Parameters
    ----------
    data
        Instance.
    fixed : ndarray of bool, shape (n_columns,)
        Variables removed from the problem.
    x_fixed : ndarray, shape (n_columns,)
        Their values; ignored where free.
    """
    pattern, values = data.pattern, data.values
    fixed_x = np.where(fixed, x_fixed, 0.0)
    b = data.b - np.bincount(pattern.rows, values * fixed_x[pattern.columns], minlength=data.b.size)
    entries = np.flatnonzero(~fixed[pattern.columns] & (values != 0.0))
    used = np.zeros(b.size, dtype=bool)
    used[pattern.rows[entries]] = True

    zero_end, cone_start = pattern.n_zero, pattern.n_zero + pattern.n_nonneg
    cones_used = used[cone_start:].reshape(-1, 3).any(axis=1)
    used[cone_start:] = np.repeat(cones_used, 3)
    empty = ~used
    if (
        np.any(np.abs(b[:zero_end][empty[:zero_end]]) > FEASIBILITY_TOLERANCE)
        or np.any(b[zero_end:cone_start][empty[zero_end:cone_start]] < -FEASIBILITY_TOLERANCE)
        or _outside_cone(b[cone_start:].reshape(-1, 3)[~cones_used])
    ):
        return ConicSolution(np.inf)

    free = np.flatnonzero(~fixed)
    row_of = np.cumsum(used) - 1
    counts = np.bincount(pattern.columns[entries], minlength=fixed.size)[free]
    shape = (int(used.sum()), free.size)
    A = sp.csc_array(
        (values[entries], row_of[pattern.rows[entries]], np.concatenate([[0], np.cumsum(counts)])),
        shape=shape,
    )
    n_zero, n_nonneg = int(used[:zero_end].sum()), int(used[zero_end:cone_start].sum())
    cones = [clarabel.ZeroConeT(n_zero)] if n_zero else []
    cones += [clarabel.NonnegativeConeT(n_nonneg)] if n_nonneg else []
    cones += [clarabel.SecondOrderConeT(3)] * int(cones_used.sum())
    offset = data.offset + float(data.q @ fixed_x)
    P = sp.csc_array((free.size, free.size))
    for refine in (False, True):
        answer = clarabel.DefaultSolver(P, data.q[free], A, b[used], cones, _settings(refine)).solve()
        status = str(answer.status)
        if status in ("Solved", "AlmostSolved"):
            x, prices = fixed_x.copy(), np.zeros(used.size)
            x[free], prices[used] = answer.x, answer.z
            bound = answer.obj_val_dual + offset
            bound -= BOUND_MARGIN * (1.0 + abs(bound))
            if status == "AlmostSolved":
                # The remaining residual is usually primal. The dual point still gives a bound, reduced by
                # the largest contribution of its residual q + A'z over all points of the program.
                bound -= MAX_VALUE * float(np.abs(data.q[free] + A.T @ prices[used]).sum())
            return ConicSolution(bound, x, prices)
        if status == "PrimalInfeasible":
            return ConicSolution(np.inf)
    return ConicSolution(-np.inf)


def lagrangian(data: ConicData, fixed: NDArray[np.bool_], x_fixed: Array, at: ConicSolution) -> float:
    """Objective of an instance with its rows priced, at a solution of another one; 0 without a solution."""
    if at.x is None or at.prices is None:
        return 0.0
    pattern, x = data.pattern, np.where(fixed, x_fixed, at.x)
    rows = np.bincount(pattern.rows, data.values * x[pattern.columns], minlength=data.b.size)
    return float(data.q @ x) + data.offset + float(at.prices @ (rows - data.b))


def _outside_cone(rows: Array) -> bool:
    return bool(np.any(rows[:, 0] + FEASIBILITY_TOLERANCE < np.hypot(rows[:, 1], rows[:, 2])))


def _settings(refine: bool) -> clarabel.DefaultSettings:
    # Iterative refinement doubles the time of a node, so it is used for retries only.
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    # The default, 1e-8, stalls where a string must end full and a balance has little slack.
    settings.static_regularization_constant = 1e-9
    settings.iterative_refinement_enable = refine
    return settings
