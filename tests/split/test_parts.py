"""Objectives, envelopes, lexicographic driver, and the compiled relaxation."""

from types import SimpleNamespace

import cvxpy as cp
import numpy as np
import pytest
import scipy.sparse as sp

import bess
from bess.control.objectives import NAMES, Objective, Objectives
from bess.control.problem import SplitProblem
from bess.control.split.normalisation import constant_scale, payoff_scale
from bess.control.split.relaxation import conic
from bess.control.split.relaxation.conic import ConicProgram, lagrangian, solve
from bess.control.split.relaxation.equations import build, compiled
from bess.convexity import convex_below


def test_default_objectives_are_case_1():
    goals = Objectives()
    assert goals.groups == ((0,), (1, 2, 3))
    assert [o.weight for o in goals.members] == [1, 1, 1, 1]


def test_groups_follow_priorities_larger_first():
    goals = Objectives(
        availability=Objective(1.0, 5), derating=2.0, inverter=Objective(0.5, 3), battery=Objective(1.0, 3)
    )
    assert goals.groups == ((0,), (2, 3), (1,))


def test_zero_weight_is_a_tie_break_in_the_search_only():
    goals, scale = Objectives(battery=0.0), np.ones((2, 4))
    assert goals.costs(scale).reported[1, 0, 3] == 0.0
    assert goals.costs(scale).searched[1, 0, 3] == 2e-4


@pytest.mark.parametrize(
    "arguments",
    [
        {"inverter": -1.0},
        {"battery": float("nan")},
        {"derating": float("inf")},
        {"inverter": "much"},
        {"inverter": True},
        {"normalisation": "none"},
        dict.fromkeys(("availability", "derating", "inverter", "battery"), 0.0),
    ],
)
def test_bad_weights_are_refused(arguments):
    with pytest.raises(bess.InputError):
        Objectives(**arguments)


@pytest.mark.parametrize("priority", [1.5, 2.0, "2", True])
def test_priority_must_be_an_integer(priority):
    with pytest.raises(bess.InputError, match="whole number"):
        Objective(1.0, priority)


def test_the_loss_of_the_reference_inverter_is_convex():
    inverter = bess.System.reference().strings[0].inverter
    loss = np.array(inverter.loss_discharge)
    np.testing.assert_allclose(convex_below(np.array(inverter.load), loss), loss, atol=1e-12)


def test_relaxation_is_dpp():
    problem, _, _ = build(2, 4, 1)
    assert problem.is_dpp()


def test_compiled_map_gives_the_data_cvxpy_gives():
    problem, variables, parameters = build(2, 3, 1)
    program = ConicProgram(problem, variables, parameters)
    rng = np.random.default_rng(0)
    values = {name: rng.uniform(0.5, 1.5, p.shape) for name, p in parameters.items()}
    for name, value in values.items():
        parameters[name].value = value
    data, _, _ = problem.get_problem_data("CLARABEL", solver_opts={})
    ours = program.load(program.parameters(values))
    A = sp.coo_array((ours.values, (ours.pattern.rows, ours.pattern.columns)), shape=data["A"].shape)
    assert abs(A - data["A"]).max() < 1e-12
    np.testing.assert_allclose(ours.b, data["b"], atol=1e-12)
    np.testing.assert_allclose(ours.q, data["c"], atol=1e-12)


@pytest.mark.parametrize("size", [(1, 1, 0), (1, 3, 1), (2, 1, 1), (2, 3, 0), (3, 2, 2), (5, 4, 1)])
def test_a_program_repeated_for_each_string_is_the_one_cvxpy_compiles_to_the_last_bit(size):
    problem, variables, parameters = build(*size)
    direct = ConicProgram(problem, variables, parameters)
    program = compiled(*size)
    rng = np.random.default_rng(0)
    values = {name: rng.uniform(0.5, 1.5, p.shape) for name, p in parameters.items()}
    data, expected = (p.load(p.parameters(values)) for p in (program, direct))
    assert (program.slices, program.shapes) == (direct.slices, direct.shapes)
    assert (data.pattern.n_zero, data.pattern.n_nonneg) == (
        expected.pattern.n_zero,
        expected.pattern.n_nonneg,
    )
    for name in ("rows", "columns"):
        np.testing.assert_array_equal(getattr(data.pattern, name), getattr(expected.pattern, name))
    for name in ("values", "b", "q", "offset"):
        np.testing.assert_array_equal(getattr(data, name), getattr(expected, name))


def test_relaxation_is_compiled_once_for_each_size():
    assert compiled(2, 2, 1) is compiled(2, 2, 1)


def _norm_program():
    x, t, limit = cp.Variable(3), cp.Variable(), cp.Parameter(3)
    # ||(x0 + x1 - 3, x1 - x2)|| <= t, x <= limit, x >= 0
    constraints = [
        cp.SOC(
            cp.reshape(t, (1,), order="F"),
            cp.reshape(cp.hstack([x[0] + x[1] - 3.0, x[1] - x[2]]), (2, 1), order="F"),
        ),
        x <= limit,
        x >= 0,
    ]
    return ConicProgram(cp.Problem(cp.Minimize(t), constraints), {"x": x, "t": t}, {"limit": limit})


def test_a_fixed_variable_leaves_the_problem_and_the_bound_matches_the_closed_form():
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 0.0])}))
    fixed = np.zeros(program.n_columns, dtype=bool)
    fixed[program.slices["x"].start + 2] = True
    answer = solve(data, fixed, np.zeros(program.n_columns))
    assert answer.x is not None
    # x0 = 1, x2 = 0, x1 = 1: minimise (x1 - 2)^2 + x1^2.
    assert answer.bound == pytest.approx(np.sqrt(2.0), abs=1e-5)
    assert answer.bound <= np.sqrt(2.0)
    assert program.value(answer.x, "x") == pytest.approx([1.0, 1.0, 0.0], abs=1e-4)


def test_a_fixed_value_that_breaks_a_row_is_infeasible_without_a_solve():
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 0.0])}))
    fixed, values = np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns)
    fixed[program.slices["x"].start] = True
    values[program.slices["x"].start] = 2.0
    assert solve(data, fixed, values).bound == np.inf


def test_an_unsolvable_node_gives_no_bound():
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([np.nan, 1.0, 0.0])}))
    answer = solve(data, np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns))
    assert answer.bound == -np.inf


def test_a_dual_point_that_is_only_almost_feasible_pays_for_its_residual(monkeypatch):
    """Clarabel's duals, a hundredth too large: their objective is above the optimum, the bound is not."""
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 0.0])}))
    real = conic.clarabel.DefaultSolver

    class AlmostSolved:
        def __init__(self, P, q, A, b, *rest):
            self.b, self.solver = b, real(P, q, A, b, *rest)

        def solve(self):
            answer = self.solver.solve()
            z = 1.01 * np.array(answer.z)
            return SimpleNamespace(
                status="AlmostSolved",
                x=answer.x,
                z=z,
                obj_val_dual=-float(self.b @ z),
                obj_val=answer.obj_val,
            )

    optimum = solve(data, np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns)).bound
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", AlmostSolved)
    answer = solve(data, np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns))
    assert answer.x is not None
    assert answer.bound <= optimum


@pytest.mark.parametrize("status", ["MaxIterations", "NumericalError", "InsufficientProgress"])
def test_only_solved_or_certified_nodes_have_a_bound(monkeypatch, status):
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 0.0])}))
    unfinished = SimpleNamespace(status=status, x=[0.0] * 4, z=[0.0] * 4, obj_val_dual=99.0, obj_val=99.0)
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", lambda *_: SimpleNamespace(solve=lambda: unfinished))
    answer = solve(data, np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns))
    assert answer.bound == -np.inf


def test_the_bound_of_a_node_is_its_dual_objective_and_a_margin_below_the_optimum():
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 1.0])}))
    answer = solve(data, np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns))
    # x = (1, 1, 1): the norm of (-1, 0).
    assert 1.0 - 1e-4 <= answer.bound < 1.0 - 5e-7


def test_the_bound_of_a_node_comes_from_its_dual_not_from_its_primal_objective(monkeypatch):
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 0.0])}))
    solved = SimpleNamespace(status="Solved", x=[0.0] * 4, z=[0.0] * 9, obj_val_dual=0.5, obj_val=2.0)
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", lambda *_: SimpleNamespace(solve=lambda: solved))
    answer = solve(data, np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns))
    assert answer.bound <= 0.5


def test_shadow_prices_predict_the_cost_of_a_tighter_limit():
    """To first order: at the point and the prices of a program that was solved."""
    program = _norm_program()
    none, zeros = np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns)
    loose, tight = (
        program.load(program.parameters({"limit": np.array([1.0, limit, 0.0])})) for limit in (0.8, 0.78)
    )
    at, costs = solve(loose, none, zeros), solve(tight, none, zeros).bound
    assert lagrangian(loose, none, zeros, at) == pytest.approx(at.bound, abs=1e-5)
    gain = lagrangian(tight, none, zeros, at) - lagrangian(loose, none, zeros, at)
    assert 0.0 < gain == pytest.approx(costs - at.bound, rel=0.1)


def test_a_fixed_variable_keeps_its_cost():
    program = _norm_program()
    data = program.load(program.parameters({"limit": np.array([1.0, 1.0, 1.0])}))
    fixed, values = np.zeros(program.n_columns, dtype=bool), np.zeros(program.n_columns)
    fixed[program.slices["t"]], values[program.slices["t"]] = True, 2.0
    assert solve(data, fixed, values).bound == pytest.approx(2.0, abs=1e-5)


def test_payoff_normalisation_divides_each_loss_by_its_range_over_the_single_optima():
    system, state, demand = (
        bess.System.reference(2),
        bess.State([0.4, 0.6], [40.0, 48.0]),
        [90.0, 60.0, 120.0],
    )
    problem = SplitProblem.check(system, 3, 0.25, state, demand, None, None)
    plain = constant_scale(system, 3, 0.25, Objectives())
    scale = payoff_scale(problem, plain, Objectives(normalisation="payoff"))
    lost_kw = []
    for alone in NAMES:
        first = {} if alone == "availability" else {alone: Objective(1.0, 2)}
        rest = {name: Objective(0.0, 1) for name in NAMES[1:] if name != alone}
        split = bess.split_power(
            system, state, demand, Objectives(availability=Objective(1.0, 3), **first, **rest)
        )
        lost_kw.append([getattr(split.rollout, f"{name}_loss_kw").sum() for name in NAMES])
    ranges_kw = np.ptp(lost_kw, axis=0)
    assert ranges_kw[0] == 0.0 and np.all(ranges_kw[1:] > 1.0)
    np.testing.assert_allclose(scale[:, 1:], np.broadcast_to(1.0 / ranges_kw[1:], (2, 3)), rtol=0.02)
    np.testing.assert_array_equal(scale[:, 0], plain[:, 0])
