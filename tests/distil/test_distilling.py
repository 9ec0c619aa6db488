"""From a study to a folder with a controller, and back into a run."""

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import bess
from bess.control.explicit import ExplicitController
from bess.control.policies.distilled import DistilledPolicy
from bess.edge.distil import distil
from bess.edge.distil.distillation import RULES, Evaluation, report, trials
from bess.edge.distil.training import TrainingCase, TrainingSet, first_weights
from bess.errors import InputError
from bess.simulation import runner
from commands import command

STUDY = {
    "name": "short",
    "demand": {"file": "two-cycle-48h"},
    "run": {"days": 0.5},
    "policy": {"foresight_h": 12.0, "rollouts": 20},
}


@pytest.fixture(scope="module")
def study() -> bess.Study:
    return bess.Study.from_document(STUDY, "test")


@pytest.fixture(scope="module")
def distilled(study: bess.Study) -> ExplicitController:
    return distil(study, generations=4, progress=False)


@pytest.fixture(scope="module")
def file(distilled: ExplicitController, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("distilled") / "policy.json"
    path.write_text(distilled.to_json(), encoding="utf-8")
    return path


def _using(study: bess.Study, file: Path, **values: object) -> bess.Study:
    return study.with_values({"policy.name": "distilled", "policy.file": str(file), **values})


def test_training_costs_less_than_what_it_began_with(
    study: bess.Study, distilled: ExplicitController
) -> None:
    training = TrainingSet(TrainingCase.of(study), distilled)
    before, after = training.costs(np.stack([first_weights(), np.array(distilled.weights)]))
    assert after < before


def test_training_repeats_to_the_last_bit(study: bess.Study, distilled: ExplicitController) -> None:
    assert distil(study, generations=4, progress=False) == distilled


def test_a_policy_on_disk_is_the_one_in_memory(
    study: bess.Study, distilled: ExplicitController, file: Path
) -> None:
    assert ExplicitController.read(file) == distilled
    from_file = bess.run(_using(study, file), progress=False).dataset
    in_memory = bess.run(study, policy=DistilledPolicy(distilled), progress=False).dataset
    np.testing.assert_array_equal(from_file.request_kw, in_memory.request_kw)


def test_many_steps_in_one_call_are_as_one_after_the_other(
    study: bess.Study, distilled: ExplicitController
) -> None:
    policy = DistilledPolicy(distilled)
    at_once = bess.run(study, policy=policy, progress=False).dataset
    in_turn = bess.run(study, policy=lambda inputs: policy(inputs), progress=False).dataset
    assert set(at_once.data_vars) == set(in_turn.data_vars)
    for name, values in in_turn.data_vars.items():
        assert at_once[name].dtype == values.dtype, name
        np.testing.assert_allclose(at_once[name], values, rtol=1e-9, atol=1e-9, err_msg=str(name))


def test_where_a_run_is_cut_makes_no_difference_to_a_bit(
    study: bess.Study, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = bess.run(_using(study, file), progress=False).dataset
    monkeypatch.setattr(runner, "MAX_PART_STEPS", 7)
    parts = bess.run(_using(study, file), progress=False).dataset
    for name, values in whole.data_vars.items():
        np.testing.assert_array_equal(parts[name], values, err_msg=str(name))


def test_training_costs_what_a_run_costs(study: bess.Study, distilled: ExplicitController) -> None:
    from bess.edge.distil.training import Variation

    training = TrainingSet(TrainingCase.of(study), distilled, (Variation(1.0),))
    cost = training.costs(np.array([distilled.weights]))[0]
    kpis = bess.run(study, policy=DistilledPolicy(distilled), progress=False).kpis
    missing = kpis["availability_loss_kwh"] + kpis["derating_loss_kwh"]
    assert cost == pytest.approx(
        3.0 * missing + kpis["inverter_loss_kwh"] + kpis["battery_loss_kwh"], rel=1e-9
    )


def test_the_controller_keeps_what_the_planner_saves(
    study: bess.Study, distilled: ExplicitController
) -> None:
    """Half a day of light load and four generations; the page on distilling has the numbers of longer
    ones."""
    made = list(trials(study, distilled))
    assert [trial.name for trial in made] == ["as studied", "demand x 0.93", "demand x 1.05"]
    for trial in made:
        assert set(trial.scores.index) == {*RULES, "mpc", "distilled"}
        kept = trial.kept("cost_kwh")
        assert kept is not None and kept > 0.9
    text = report(study, distilled, made)
    assert "| as studied |" in text and "`distilled`" in text


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"system.n_strings": 3}, "distilled for 2 strings, this plant has 3"),
        ({"policy.foresight_h": 24.0}, "a forecast of 12 h, this study has a forecast of 24 h"),
        ({"system.parameters.control.step_min": 5.0}, "steps of 0.25 h, this study has steps of 0.0833"),
        ({"system.parameters.battery.r_scale": 1.1}, "resistance_ohm differ"),
    ],
)
def test_a_controller_of_another_plant_is_refused(
    study: bess.Study, file: Path, values: dict[str, object], reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        bess.run(_using(study, file, **values), progress=False)


def test_a_file_that_is_no_controller_is_refused_with_what_to_do(
    study: bess.Study, file: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"needs policy\.file"):
        bess.run(study.with_values({"policy.name": "distilled"}), progress=False)
    with pytest.raises(InputError, match="no such file"):
        bess.run(_using(study, tmp_path / "none.json"), progress=False)
    good = json.loads(file.read_text(encoding="utf-8"))
    spoiled = {
        "text": "soc = 1",
        "list": "[]",
        "too few weights": json.dumps({**good, "weights": good["weights"][:-1]}),
        "a weight that is not finite": json.dumps({**good, "weights": [float("nan"), *good["weights"][1:]]}),
        "a table too short": json.dumps(
            {**good, "tables": {**good["tables"], "ocv_v": good["tables"]["ocv_v"][:-1]}}
        ),
        "another format": json.dumps({**good, "format": 2}),
        "weights twice": json.dumps(good)[:-1] + f', "weights": {json.dumps(good["weights"])}}}',
    }
    for name, text in spoiled.items():
        path = tmp_path / "spoiled.json"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"spoiled\.json"):
            bess.run(_using(study, path), progress=False)
            pytest.fail(name)


def test_a_plant_that_loses_nothing_has_no_share_of_savings() -> None:
    nothing = dict.fromkeys([*RULES, "mpc", "distilled"], (0.0, 0.0))
    scores = pd.DataFrame.from_dict(nothing, "index", columns=["lost_kwh", "cost_kwh"])
    assert Evaluation("no demand", scores).kept("lost_kwh") is None


def test_the_command_writes_a_controller_and_says_what_was_lost(tmp_path: Path) -> None:
    study = tmp_path / "short.toml"
    study.write_text('[demand]\nfile = "two-cycle-48h"\n[run]\ndays = 0.25\n', encoding="utf-8")
    out = tmp_path / "made"
    words = ["distil", str(study), "--out", str(out), "--generations", "0", "--set", "policy.foresight_h=6"]
    done = command(*words)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {
        "policy.json", "split.c", "split.h", "split.st", "study.toml", "report.md",
    }  # fmt: skip
    assert str(out / "report.md") in done.stdout
    (out / "notes.txt").touch()
    again = command(*words)
    assert again.returncode == 2
    assert "holds 'notes.txt'" in again.stderr


def test_the_service_decides_as_the_distilled_policy_does_in_a_run(
    study: bess.Study, file: Path, tmp_path: Path
) -> None:
    pytest.importorskip("prometheus_client")
    from bess.edge.plant_io import Measurements
    from bess.edge.serve.service import Service

    service = Service(_using(study, file), tmp_path)
    n = service.controller.n_strings
    measured = Measurements(
        time=datetime.now(UTC),
        soc=np.linspace(0.4, 0.6, n),
        temperature_c=np.full(n, 25.0),
        power_kw=np.full(n, np.nan),
        charge_limit_kw=np.full(n, np.inf),
        discharge_limit_kw=np.full(n, np.inf),
        available=np.ones(n, dtype=bool),
    )
    ahead = [20.0 * n] * service.controller.plan.n_steps
    service.controller.step(measured, ahead[0], service.clock(), forecast_kw=ahead, wait_s=5.0)
    state = bess.State(soc=measured.soc, temperature_c=measured.temperature_c)
    decided = ExplicitController.read(file).split(state, np.array(ahead), np.full(n, 92.0))
    plan = service.controller.plan.current
    service.close()
    assert plan is not None
    np.testing.assert_allclose(plan.request_kw[:, 0], decided)
