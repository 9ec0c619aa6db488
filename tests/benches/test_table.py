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
