"""Runs side by side: where more than their control differs, that is said first and none is best."""

from pathlib import Path

import pytest

import bess
from bess.cli.records import runs_of
from bess.report.page import write_comparison
from bess.report.words.summary import unlike
from commands import command

BASE = {"policy.name": "soc", "run.days": 0.25, "system.initial_soc": [0.3, 0.7]}


def made(folder: Path, name: str, **values: object) -> Path:
    keys = {key.replace("__", "."): value for key, value in values.items()}
    bess.run(bess.load_study("case1", BASE | keys), out=folder / name, progress=False)
    return folder / name


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("runs"), "first")


def test_runs_of_another_policy_are_alike(first: Path, tmp_path: Path) -> None:
    other = made(tmp_path, "equal", policy__name="equal", policy__horizon_steps=4, title="x")
    runs = runs_of([first, other])
    assert unlike(runs) == ""
    page = write_comparison(runs, tmp_path / "page").read_text(encoding="utf-8")
    assert "These runs differ in policy.name (soc; equal), policy.horizon_steps" in page
    assert 'class="best"' in page and "best marked" in page and "Lowest undelivered + losses" in page


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            {"system__n_strings": 4, "system__initial_soc": 0.5},
            "system (2 strings, 184 kW, 536 kWh; 4 strings, 368 kW, 1072 kWh)",
        ),
        ({"run__days": 0.5}, "length (6 h; 12 h)"),
        ({"demand__scale": 0.5}, "demand.scale (1.0; 0.5)"),
        ({"demand__file": "frequency-week"}, "demand.file (two-cycle-48h; frequency-week)"),
        ({"system__initial_soc": 0.7}, "system (2 strings, 184 kW, 536 kWh, not the same)"),
        ({"run__start": "2024-06-01T00:00:00Z"}, "start (2024-01-01 00:00 UTC; 2024-06-01 00:00 UTC)"),
        ({"wear__eur_per_mwh": 30.0}, "wear.eur_per_mwh (not set; 30.0)"),
    ],
)
def test_what_differs_beside_the_control_is_said(
    values: dict[str, object], said: str, first: Path, tmp_path: Path
) -> None:
    assert said in unlike(runs_of([first, made(tmp_path, "other", **values)]))


def test_none_of_unlike_runs_is_marked_best(first: Path, tmp_path: Path) -> None:
    runs = runs_of([first, made(tmp_path, "other", run__days=0.5)])
    page = write_comparison(runs, tmp_path / "page").read_text(encoding="utf-8")
    assert 'class="best"' not in page and 'class="behind"' not in page and "best marked" not in page
    assert "Lowest undelivered" not in page and "against" not in page.partition("</header>")[2][:2000]
    assert "none of them is marked best" in page
    subject = page.partition('class="subject">')[2].partition("<")[0]
    assert subject == "2 scenarios · policy soc", "nothing is said of all that holds for one"


def test_a_data_file_is_told_by_its_content(tmp_path: Path) -> None:
    rows = [f"2024-01-01 {hour:02d}:00Z,{{}}\n" for hour in range(8)]
    folders = []
    for name, power in (("a", 20), ("b", 20), ("c", 30)):
        (tmp_path / f"{name}.csv").write_text("time,power_kw\n" + "".join(row.format(power) for row in rows))
        folders.append(made(tmp_path, f"run-{name}", demand__file=str(tmp_path / f"{name}.csv")))
    assert unlike(runs_of(folders[:2])) == ""
    assert "demand.file (b.csv; c.csv)" in unlike(runs_of(folders[1:]))


def test_another_version_is_said(first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bess.simulation.record.provenance.__version__", "99.0")
    said = unlike(runs_of([first, made(tmp_path, "other", policy__name="equal")]))
    assert f"version ({bess.__version__}; 99.0)" in said


def test_the_command_says_it_before_the_table(first: Path, tmp_path: Path) -> None:
    other = made(tmp_path, "other", system__n_strings=4, system__initial_soc=0.5, run__days=0.5)
    ended = command("compare", str(first), str(other), "--out", str(tmp_path / "page"))
    assert ended.returncode == 0, ended.stderr
    printed = ended.stdout.splitlines()
    assert printed[0].startswith("These runs are unlike, so none of them is marked best: system (2 strings")
