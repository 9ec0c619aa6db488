"""Claims about the comparison with other packages: alike for all, and honest about who is missing."""

import sys
from pathlib import Path

import numpy as np
import pytest

import bess

BENCHES = Path(__file__).parents[2] / "benches"


@pytest.fixture(autouse=True)
def path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHES / "contenders"))
    monkeypatch.syspath_prepend(str(BENCHES))


def test_objective_of_the_comparison_is_the_one_the_split_reports() -> None:
    import splits

    system = bess.System.reference(n_strings=2)
    state, demand_kw = splits.regular(3, 2, 4)
    for weights in splits.WEIGHTS.values():
        goals = bess.Objectives(derating=weights[0], inverter=weights[1], battery=weights[2])
        split = bess.split_power(system, state, demand_kw, objectives=goals)
        value, shed_kw = splits.objective(system, state, split.request_kw, weights)
        assert value == pytest.approx(split.objective, rel=1e-9)
        assert shed_kw == pytest.approx(split.availability_loss_kw, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "package", "tolerance"),
    [
        ("gurobi", "gurobipy", 1e-5),
        ("scip", "pyscipopt", 1e-4),
        ("bonmin", "casadi", 5e-3),  # its splines through the tables' knots bulge between them
    ],
)
def test_a_rivals_own_objective_is_that_of_the_control_model(
    name: str, package: str, tolerance: float
) -> None:
    pytest.importorskip(package)
    import splits

    system = bess.System.reference(n_strings=2)
    for seed, label in ((0, "S1"), (1, "ones"), (5, "S1")):  # charge, discharge, one string off
        state, demand_kw = splits.regular(seed, 2, 2)
        found = splits.rival(name, system, splits.WEIGHTS[label])(state, demand_kw)
        value, shed_kw = splits.objective(system, state, found.request_kw, splits.WEIGHTS[label])
        assert found.finished
        assert found.request_kw.sum(axis=0) == pytest.approx(demand_kw, abs=1e-3)
        assert shed_kw == 0.0
        assert found.objective == pytest.approx(value, rel=tolerance)


@pytest.mark.parametrize(("name", "package"), [("gurobi", "gurobipy"), ("scip", "pyscipopt")])
def test_a_rivals_equations_hold_where_strings_derate(name: str, package: str) -> None:
    pytest.importorskip(package)
    import splits

    system, weights = bess.System.reference(n_strings=2), splits.WEIGHTS["ones"]
    state, demand_kw = bess.State(np.array([0.5, 0.4]), np.array([48.0, 50.0])), np.array([60.0, 80.0])
    found = splits.rival(name, system, weights)(state, demand_kw)
    assert bess.rollout(system, state, found.request_kw).derating_loss_kw.sum() > 1.0
    value, _ = splits.objective(system, state, found.request_kw, weights)
    assert found.objective == pytest.approx(value, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "package"), [("gurobi", "gurobipy"), ("scip", "pyscipopt"), ("bonmin", "casadi")]
)
def test_a_time_limit_is_never_called_finished(name: str, package: str) -> None:
    module = pytest.importorskip(f"{name}_split", reason=f"{package} is not installed", exc_type=ImportError)
    import equations
    import splits

    system = bess.System.reference(n_strings=2)
    state, demand_kw = splits.regular(0, 2, 4)
    try:
        found = equations.split(
            module.Program(), system, state, demand_kw, splits.WEIGHTS["ones"], gap=0.0, time_limit_s=0.02
        )
    except RuntimeError:
        return  # no split by then: said, too
    assert not found.finished
    assert np.abs(found.request_kw).sum(axis=0) == pytest.approx(np.abs(demand_kw), abs=1e-3)


def test_a_stopped_rival_is_a_lower_bound_and_not_at_the_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    import table

    def entry(seed: int, seconds: float, finished: bool) -> dict[str, object]:
        return {"weights": "S1", "seed": seed, "seconds": seconds, "finished": finished, "objective": 1.0}

    runs = {
        "bess": [entry(seed, 0.01, True) for seed in range(3)],
        "gurobi": [entry(seed, 1.0, True) for seed in range(3)],
        "bonmin": [{"weights": "S1", "seed": seed, "missing": "no split"} for seed in range(3)],
        "scip": [
            entry(0, 1.0, True),
            entry(1, 100.0, False),
            {"weights": "S1", "seed": 2, "missing": "no split"},
        ],
    }
    monkeypatch.setattr(table, "run_contender", lambda script, name, states, steps: table.Outcome(runs[name]))
    bench = table.Bench(table.Table("", "measured", "beside"))
    table.splits(bench, 3, 4)
    beside = {name.rpartition(" ")[2]: row for name, _, row in bench.rows}
    assert beside["gurobi"].startswith("100 x (") and beside["gurobi"].endswith("; 3 of 3 to the gap")
    assert beside["bonmin"] == "0 of 3 to the gap"
    assert beside["scip"].startswith("at least 1000 x (")
    assert beside["scip"].endswith("; 1 of 3 to the gap, 1 stopped at the time limit with a split")
    assert bench.figures["scip against bess, 4 steps"]["without_a_split"] == 1


def test_crumbs_of_a_solver_move_to_the_other_string() -> None:
    import splits

    request_kw = np.array([[1e-6, 40.0, 0.0], [60.0, -1e-7, 0.0]])
    cleaned = splits.without_crumbs(request_kw)
    assert cleaned[0, 0] == cleaned[1, 1] == 0.0
    assert cleaned.sum(axis=0) == pytest.approx(request_kw.sum(axis=0))


def test_a_missing_rival_is_said_to_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import contender

    monkeypatch.setattr(contender, "FOLDER", tmp_path)
    (tmp_path / "rival.py").write_text("import surely_not_installed\n")
    (tmp_path / "broken.py").write_text("raise RuntimeError('no licence')\n")
    (tmp_path / "chatty.py").write_text("print('banner', 'RESULT [1]', '\\nnoise', '\\nRESULT [2]')\n")
    missing, broken, chatty = (contender.run_contender(f"{n}.py") for n in ("rival", "broken", "chatty"))
    assert missing.figures is None and missing.reason == "not installed ('surely_not_installed')"
    assert broken.figures is None and broken.reason == "failed: RuntimeError: no licence"
    assert chatty.figures == [[1], [2]]


def test_machine_is_described_with_versions() -> None:
    import machine

    described = machine.describe_machine()
    assert described["packages"]["bess-powersplit"] == bess.__version__
    assert described["python"] == ".".join(map(str, sys.version_info[:3]))
    assert described["cpu"]
