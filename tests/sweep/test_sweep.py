"""Claims about sweeps: every scenario is run once, whatever happens to the others and to the workers."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.errors import BessError, InputError
from bess.simulation.record.result import RESULTS, open_result
from bess.simulation.runner import run
from bess.simulation.sweep import run_sweep, write_table
from bess.study import expand, load_study
from bess.study.study import Study
from commands import command

pytestmark = pytest.mark.process  # by a cluster that all of them use

HUNG_S = 600.0
"""Time after which a command is taken for hung, also on a slow machine."""

STUDY = """
title = "Initial SOC and temperature"
[demand]
file = "two-cycle-48h"
repeat = true
[policy]
name = "equal"
[run]
days = {days}
[[scenario]]
name = "cold"
set = {{ "system.initial_temperature_c" = 15.0 }}
[[scenario]]
name = "warm"
set = {{ "system.initial_temperature_c" = 35.0 }}
[[sweep]]
key = "system.initial_soc"
values = [0.2, 0.5, 0.8]
"""


def study_of(folder: Path, days: float, extra: str = "") -> Study:
    path = folder / "soc.toml"
    path.write_text(STUDY.format(days=days) + extra)
    return load_study(path)


@pytest.mark.parametrize("name", ["cold", "Cold"])
def test_runs_that_would_share_a_folder_are_refused(name: str, tmp_path: Path) -> None:
    study = study_of(tmp_path, 1, f'[[scenario]]\nname = "{name}"\nset = {{}}\n')
    with pytest.raises(InputError, match=rf"'cold_initial_soc=0\.2' and '{name}_initial_soc=0\.2' have one"):
        expand(study)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        yield cluster


def test_a_sweep_runs_every_combination_and_tables_it(tmp_path: Path, cluster: Any) -> None:
    study = study_of(tmp_path, 0.5)
    result = run_sweep(study, tmp_path / "out", scheduler=cluster.scheduler_address, progress=False)
    assert list(result.outcomes) == list(expand(study)) and len(result.outcomes) == 6
    assert result.failed == {} and result.skipped == []
    table = result.table()
    assert table["status"].tolist() == ["done"] * 6
    assert table["system.initial_soc"].tolist() == [0.2, 0.5, 0.8] * 2
    assert table["system.initial_temperature_c"].tolist() == [15.0] * 3 + [35.0] * 3
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "out" / "sweep.parquet")[["name", "system_efficiency_pct"]],
        table[["name", "system_efficiency_pct"]],
    )
    alone = run(expand(study)["warm_initial_soc=0.8"], progress=False)
    row = table[table["name"] == "warm_initial_soc=0.8"].iloc[0]
    assert row["system_efficiency_pct"] == alone.kpis["system_efficiency_pct"]

    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob(f"*/{RESULTS}")}
    again = run_sweep(study, tmp_path / "out", scheduler=cluster.scheduler_address, progress=False)
    assert sorted(again.skipped) == sorted(result.outcomes)
    assert {path: path.stat().st_mtime_ns for path in written} == written
    assert again.table()["system_efficiency_pct"].tolist() == table["system_efficiency_pct"].tolist()


def test_a_failed_scenario_is_reported_and_the_rest_finished(tmp_path: Path, cluster: Any) -> None:
    broken = '\n[[sweep]]\nkey = "demand.file"\nvalues = ["two-cycle-48h", "no-such-file.csv"]\n'
    (tmp_path / "soc.toml").write_text(STUDY.format(days=0.25).replace(", 0.8]", "]") + broken)
    study = load_study(tmp_path / "soc.toml")
    result = run_sweep(study, tmp_path / "out", scheduler=cluster.scheduler_address, progress=False)
    assert len(result.failed) == 4 and all("no-such-file.csv" in error for error in result.failed.values())
    table = result.table().set_index("name")
    assert (table["status"] == "done").sum() == 4
    assert table.loc[list(result.failed), "system_efficiency_pct"].isna().all()
    from bess.report import write_report

    page = write_report(tmp_path / "out").read_text(encoding="utf-8")
    (first, *others) = result.failed
    assert f"Missing: {first} and {len(others)} more: " in page
    assert "Pareto front" in page and "The front of inverter and battery efficiency has no knee" in page


def test_a_killed_worker_does_not_lose_the_sweep(tmp_path: Path, cluster: Any) -> None:
    study = study_of(tmp_path, 8)
    out = tmp_path / "out"
    finished: list[Any] = []
    sweep = threading.Thread(
        target=lambda: finished.append(
            run_sweep(study, out, scheduler=cluster.scheduler_address, progress=False)
        )
    )
    sweep.start()
    workers = {worker.pid for worker in cluster.workers.values()}
    name, pid = _in_mid_run(out, workers)
    os.kill(pid, signal.SIGKILL)
    assert not (out / name / RESULTS).exists()
    sweep.join(timeout=HUNG_S)
    assert not sweep.is_alive()
    (result,) = finished
    assert result.failed == {} and len(result.outcomes) == 6
    assert pid not in {worker.pid for worker in cluster.workers.values()}
    undisturbed = run(expand(study)[name], progress=False)
    with open_result(out / name) as dataset:
        for variable in undisturbed.dataset.data_vars:
            np.testing.assert_array_equal(dataset[variable].values, undisturbed.dataset[variable].values)


def _in_mid_run(out: Path, workers: set[int], patience_s: float = 60.0) -> tuple[str, int]:
    """Name and process of a scenario that has saved a part and is not finished."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        for lock in out.glob("*/.lock-owner"):
            text = lock.read_text()
            if text.isdigit() and int(text) in workers and list(lock.parent.glob("parts/*.npz")):
                return lock.parent.name, int(text)
        time.sleep(0.005)
    raise AssertionError("no scenario was seen in mid-run")


def test_a_local_cluster_of_processes_is_the_default(tmp_path: Path) -> None:
    path = tmp_path / "one.toml"
    path.write_text('[demand]\nfile = "two-cycle-48h"\n[policy]\nname = "equal"\n[run]\ndays = 0.25\n')
    result = run_sweep(path, tmp_path / "out", workers=1, progress=False)
    assert list(result.outcomes) == ["one"] and result.failed == {}
    kpis = json.loads((tmp_path / "out" / "one" / "kpis.json").read_text())
    assert result.table()["availability_pct"].tolist() == [kpis["availability_pct"]]


def test_a_script_that_its_workers_would_run_again_is_told_what_to_write(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("import bess\nbess.run_sweep('case2', 'out', workers=1, progress=False)\n")
    ended = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, cwd=tmp_path, timeout=HUNG_S, check=False
    )
    last = ended.stderr.strip().splitlines()[-1]
    assert last.startswith("bess.errors.BessError: the workers of the sweep did not start (")
    assert last.endswith("call run_sweep under if __name__ == '__main__' there")


@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:1"}, InputError, "either --workers or --scheduler"),
        ({"workers": 0}, InputError, "workers = 0"),
    ],
)
def test_bad_choices_of_workers_are_refused(
    tmp_path: Path, kwargs: Any, error: type[BessError], message: str
) -> None:
    with pytest.raises(error, match=message):
        run_sweep(study_of(tmp_path, 0.25), tmp_path / "out", progress=False, **kwargs)


def test_objectives_stand_in_the_table_as_numbers_under_the_keys_of_the_study(tmp_path: Path) -> None:
    study = load_study("pareto")
    write_table(tmp_path, study, expand(study), {})
    table = pd.read_csv(tmp_path / "sweep.csv")
    weights = table[["policy.objectives.inverter", "policy.objectives.battery"]]
    np.testing.assert_allclose(weights.to_numpy().sum(axis=1), 1.0)
    assert weights.dtypes.tolist() == [np.float64] * 2
    assert not [name for name in table if name.endswith(("priority", "weight", "_tol"))]


def test_a_swept_list_stands_in_the_table_as_in_a_study_file(tmp_path: Path) -> None:
    study = load_study(
        "case1", {"sweep": [{"key": "system.initial_soc", "values": [[0.5, 0.5], [0.2, 0.8]]}]}
    )
    write_table(tmp_path, study, expand(study), {})
    assert pd.read_csv(tmp_path / "sweep.csv")["system.initial_soc"].tolist() == ["[0.5, 0.5]", "[0.2, 0.8]"]


def test_a_priority_that_differs_between_scenarios_has_a_column_of_its_own(tmp_path: Path) -> None:
    study = load_study("case2").with_values(
        {
            "scenario": [
                {"name": name, "set": {"policy.objectives.derating": {"weight": 1.0, "priority": priority}}}
                for name, priority in (("blended", 1), ("first", 3))
            ]
        }
    )
    write_table(tmp_path, study, expand(study), {})
    table = pd.read_csv(tmp_path / "sweep.csv")
    assert table["policy.objectives.derating"].tolist() == [1.0, 1.0]
    assert table["policy.objectives.derating.priority"].tolist() == [1, 3]


def test_the_bundled_front_has_21_weights_that_sum_to_one() -> None:
    runs = expand(bess.load_study("pareto"))
    goals = [study.policy.objectives for study in runs.values()]
    assert len(runs) == 21
    assert all(goal.inverter.weight + goal.battery.weight == pytest.approx(1.0) for goal in goals)
    assert sorted(goal.inverter.weight for goal in goals) == pytest.approx([i / 20 for i in range(21)])


def bess_sweep(study: Path, out: Path, *options: str) -> subprocess.Popen[str]:
    """The command in a group of processes of its own, as a terminal starts it."""
    words = [sys.executable, "-m", "bess", "sweep", str(study), "--out", str(out), *options]
    return subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def test_one_bad_value_is_said_once_with_the_count(tmp_path: Path, cluster: Any) -> None:
    study_of(tmp_path, 0.25, '[system]\nfile = "nowhere.toml"\n')
    options = "--out", str(tmp_path / "out"), "--scheduler", cluster.scheduler_address
    ended = command("sweep", str(tmp_path / "soc.toml"), *options)
    said = ended.stderr
    assert ended.returncode == 1
    last = said.strip().splitlines()[-1]
    assert last.startswith("bess: 6 of 6 runs failed: ") and last.count("nowhere.toml: no such file") == 1
    assert " and 5 more: " in last
    assert said.count("nowhere.toml") == 2  # as soon as it is known, and at the end


def test_ctrl_c_ends_a_sweep_with_one_line_and_none_of_its_workers(tmp_path: Path) -> None:
    study_of(tmp_path, 300)
    sweep = bess_sweep(tmp_path / "soc.toml", tmp_path / "out", "--workers", "2")
    deadline = time.monotonic() + HUNG_S
    while not list((tmp_path / "out").glob("*/parts/*.npz")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(sweep.pid, signal.SIGINT)  # as a terminal sends it: to the workers too
    _, said = sweep.communicate(timeout=HUNG_S)
    assert sweep.returncode == 3
    lines = [line for line in said.splitlines() if line.strip() and not line.startswith("scenarios ")]
    assert len(lines) == 1 and "run the same sweep again to continue" in lines[0], said
