"""Claims about the command: what it prints, its exit statuses, one line for every error, and a fast start."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import bess
from bess.cli.records import kpi_table
from bess.cli.studies import findings
from bess.control.policies import POLICIES
from bess.study import bundled_studies
from commands import command, refused

SHARED = Path(__file__).parents[3] / "shared/data/prices"
PRICES = SHARED / "smard_de_viertelstunde_2024_berechnet_resaved.csv"


def process(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "bess", *words], capture_output=True, text=True, check=False)


def test_help_and_version_load_none_of_the_heavy_libraries() -> None:
    heavy = {
        "cvxpy",
        "pandas",
        "xarray",
        "scipy",
        "matplotlib",
        "distributed",
        "bokeh",
        "h5py",
        "numpy",
    }
    for words in (["--help"], ["--version"], ["run", "--help"]):
        script = (
            "import sys\nfrom bess.cli import main\n"
            f"sys.argv = ['bess', *{words!r}]\n"
            "try:\n    main()\nexcept SystemExit as ended:\n    assert not ended.code\n"
            "print(','.join(name for name in sys.modules if '.' not in name), file=sys.stderr)\n"
        )
        ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        loaded = set(ended.stderr.strip().split(","))
        assert not loaded & heavy
        assert ended.stdout


def test_import_loads_none_of_the_heavy_libraries() -> None:
    script = "import sys, bess; print(','.join(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert not {"cvxpy", "pandas", "xarray", "scipy", "matplotlib", "distributed"} & set(
        loaded.strip().split(",")
    )


def test_version_is_that_of_the_package() -> None:
    assert process("--version").stdout == f"bess {bess.__version__}\n"


@pytest.mark.parametrize("words", [["list", "cells"], ["run", "nosuch"], ["fly"]])
def test_a_process_prints_and_ends_as_the_other_tests_see_it(words: list[str]) -> None:
    alone, within = process(*words), command(*words)
    assert alone.returncode == within.returncode
    assert (alone.stdout, alone.stderr) == (within.stdout, within.stderr)


def test_list_names_everything_that_comes_along() -> None:
    text = command("list").stdout
    for name in [*bundled_studies(), *POLICIES, "reference", "samsung-94ah", "sinamics-s120"]:
        assert name in text


def test_list_of_a_kind_and_words_names_what_has_them_all() -> None:
    text = command("list", "cells", "LFP").stdout
    assert text.startswith("cells\n") and "sony-lfp-3ah" in text
    assert "nmc-reference" not in text and "naumann-lfp" not in text
    assert command("list", "policy").stdout.splitlines()[0] == "policies"
    assert {"sony-lfp-3ah", "naumann-lfp"} <= set(command("list", "lfp").stdout.split())
    assert "no entry contains 'tesla'; omit words" in refused("list", "inverters", "tesla")


@pytest.mark.parametrize(
    ("begun", "number", "offered"),
    [
        ("bess ru", 1, ["run"]),
        ("bess run case1", 2, ["case1"]),
        ("bess run case1 --set policy.na", 4, ["policy.name"]),
        ("bess list ce", 2, ["cells"]),
    ],
)
def test_a_shell_is_offered_what_may_come(begun: str, number: int, offered: list[str]) -> None:
    asked = {"_BESS_COMPLETE": "complete_bash", "COMP_WORDS": begun, "COMP_CWORD": str(number)}
    ended = subprocess.run(
        [sys.executable, "-m", "bess"],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stdout.split() == offered


def test_completion_installs_a_script_for_the_shell(tmp_path: Path) -> None:
    asked = {"HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    words = [sys.executable, "-m", "bess", "--install-completion", "bash"]
    subprocess.run(words, env=os.environ | asked, capture_output=True, text=True, check=True)
    script = "\n".join(path.read_text() for path in tmp_path.rglob("*") if path.is_file())
    assert "_BESS_COMPLETE=complete_bash" in script
    assert "complete -o default -F _bess_completion bess" in script


def test_run_writes_the_documented_files_and_prints_the_key_figures(tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = process("run", "case1", "--days", "0.5", "--set", "policy.name=equal", "--out", str(out))
    assert ended.returncode == 0, ended.stderr
    assert {path.name for path in out.iterdir()} >= {"study.toml", "results.nc", "kpis.json", "log.jsonl"}
    kpis = json.loads((out / "kpis.json").read_text())
    assert f"{kpis['system_efficiency_pct']:.2f}" in ended.stdout
    assert "step 48 of 48 (100 %)" in ended.stderr
    assert "\x1b" not in ended.stderr + ended.stdout
    assert bess.open_result(out).sizes["time"] == 48
    assert (out / "log.jsonl").read_text() == ""  # nothing was solved, nothing was unmet


def test_the_resolved_study_runs_again_to_the_same_result(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert (
        command("run", "case1", "--days", "0.25", "--set", "policy.name=soc", "--out", str(first)).returncode
        == 0
    )
    assert command("run", str(first / "study.toml"), "--out", str(second)).returncode == 0
    assert bess.open_result(first).identical(bess.open_result(second))


def test_scenarios_get_a_sub_folder_each(tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = command("run", "case2", "--days", "0.25", "--set", "policy.name=equal", "--out", str(out))
    assert ended.returncode == 0, ended.stderr
    for name in ("S1", "S2", "S3"):
        assert bess.open_result(out / name).sizes["time"] == 24
        assert (out / name / "kpis.json").exists()
        assert name in ended.stdout.splitlines()[0]


def test_without_out_every_run_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    words = ("run", "case1", "--days", "0.25", "--set", "policy.name=equal")
    for _ in range(2):
        assert command(*words, folder=tmp_path).returncode == 0
    assert {path.name for path in (tmp_path / "results").iterdir()} == {"case1", "case1-2"}


def test_check_runs_nothing_and_says_what_it_found(tmp_path: Path) -> None:
    ended = command(
        "check", "case1", "--set", "demand.scale=3", "--set", "policy.name=equal", folder=tmp_path
    )
    assert ended.returncode == 0
    assert "period: 2024-01-01 00:00 to 2024-01-03 00:00 UTC, 192 steps of 15 min" in ended.stdout
    assert "-234 to 234 kW" in ended.stdout
    assert "above the 184 kW of the plant" in ended.stdout
    assert ended.stdout.count("policy: equal\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("mode", "said"), [("certified", "certified over 2 h"), ("plan", "planned over 30 h, not certified")]
)
def test_check_says_how_far_the_optimiser_looks_and_whether_it_certifies(mode: str, said: str) -> None:
    kind = ["--set", "policy.objectives.kind=energy"]
    text = command("check", "case1", "--set", f"policy.mode={mode}", *kind).stdout
    assert f"policy: mpc, {said}\n" in text


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (["system.parameters.battery.soc_min=0.9"], "soc 0.5 is outside its window [0.9, 1]"),
        (["policy.mode=plan", "policy.objectives.kind=money"], "this study has no prices"),
        (["system.parameters.thermal.spatial.conductivity_w_mk=1e5"], "stable"),
    ],
)
def test_what_the_first_step_would_refuse_is_found_by_check_and_leaves_no_folder(
    values: list[str], said: str, tmp_path: Path
) -> None:
    words = ["case1", *(word for value in values for word in ("--set", value))]
    for ended in (
        command("check", *words, folder=tmp_path),
        command("run", *words, "--days", "1", "--out", "out", folder=tmp_path),
    ):
        assert ended.returncode == 2 and said in ended.stderr
        assert len(ended.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_an_error_in_one_of_several_runs_names_the_run(tmp_path: Path) -> None:
    scenario = {"name": "full", "set": {"system.initial_soc": [0.5, 0.5, 0.5]}}
    study = bess.load_study("case1", {"run.days": 0.25, "scenario": [{"name": "usual", "set": {}}, scenario]})
    study_file = tmp_path / "study.toml"
    study_file.write_text(study.to_toml(), encoding="utf-8")
    for words in (("check",), ("run", "--out", "out")):
        ended = command(words[0], str(study_file), *words[1:], folder=tmp_path)
        said = ended.stderr.splitlines()[-1]
        assert (ended.returncode, said) == (2, "bess: full: system.initial_soc: 3 values for 2 strings")


def test_check_estimates_more_time_for_more_strings_longer_plans_and_more_days() -> None:
    def seconds(**values: object) -> float:
        planned = {"policy.mode": "plan", "policy.objectives.kind": "energy"}
        keys = {key.replace("__", "."): value for key, value in values.items()}
        lines = "\n".join(findings(bess.load_study("case1", planned | keys)))
        return float(re.findall(r"time: about (\S+) CPU s", lines)[-1])

    assert seconds(policy__name="soc") < seconds()
    assert seconds() < seconds(system__n_strings=32) < seconds(system__n_strings=1000)
    assert seconds() < seconds(run__days=20) < seconds(run__days=20, policy__foresight_h=48)


def test_check_names_the_prices_it_found() -> None:
    if not PRICES.exists():
        pytest.skip(f"{PRICES} is not there")
    text = command("check", "arbitrage-2024", "--set", f"demand.prices={PRICES}").stdout
    assert "-135.45 / 78.51 / 936.28 EUR/MWh" in text
    assert "2023-12-31 23:00 to 2024-12-31 23:00 UTC, 35136 steps of 15 min" in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run", "nosuch"], "nosuch: no such study"),
        ([], "Missing command. (see bess --help)"),
        (["run", "missing.toml"], "missing.toml: no such study; check the path"),
        (["run", "nowhere/missing.toml"], "check the path, there is no folder nowhere"),
        (
            ["run", "case1", "--set", "system.n_strings=0"],
            "n_strings = 0: must be in [1, 1000]",
        ),
        (["run", "case1", "--set", "run.days=abc"], "run.days = 'abc': must be a number"),
        (["run"], "Missing argument"),
        (["fly"], "No such command 'fly'"),
        (["run", "case1", "--dayz", "1"], "No such option: --dayz"),
        (["run", "case1", "--days", "soon"], "--days"),
        (["run", "case1", "--days", "-2"], "run.days = -2.0: must be in (0, 36525] days"),
        (["run", "case1", "--set", "policy.horizon=4"], "did you mean 'policy.horizon_steps'?"),
        (["run", "case1", "--set", "policy.horizon_steps"], "write key=value"),
        (["run", "case1", "--set", "policy.horizon_steps=[4"], "is not a TOML value"),
        (["run", "case1", "--set", "policy.horizon_steps=many"], "policy.horizon_steps = 'many'"),
        (["run", "case1", "--set", "demand.file=none.csv"], "none.csv"),
        (["run", "case1", "--set", "system.file=none.toml"], "none.toml: no such file"),
        (["run", "case1", "--set", "weather.file=none.csv"], "none.csv"),
        (["run", "case1", "--resume"], "--resume: specify the folder of the run with --out"),
        (["run", "arbitrage-2024"], "demand.prices is not set"),
        (["run", "arbitrage-2024", "--set", "demand.prices=none.csv"], "none.csv"),
        (["report", "nowhere"], "nowhere"),
        (["sweep", "case1", "--workers", "0"], "--workers"),
    ],
)
def test_bad_input_is_one_line_and_status_2(words: list[str], expected: str, tmp_path: Path) -> None:
    assert expected in refused(*words, folder=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_zone_names_the_zones_of_the_file() -> None:
    if not PRICES.exists():
        pytest.skip(f"{PRICES} is not there")
    line = refused("run", "arbitrage-2024", "--set", f"demand.prices={PRICES}", "--set", "demand.zone=FR")
    assert "FR" in line and "Deutschland/Luxemburg" in line


def test_gaps_and_nan_in_a_profile_are_refused(tmp_path: Path) -> None:
    rows = [f"2024-06-01T{hour:02d}:{minute:02d}Z,10" for hour in range(8) for minute in (0, 15, 30, 45)]
    broken = {
        "gap": rows[:8] + rows[20:],
        "nan": [row.replace(",10", ",nan") if 8 <= i < 20 else row for i, row in enumerate(rows)],
    }
    for name, lines in broken.items():
        path = tmp_path / f"{name}.csv"
        path.write_text("time,power_kw\n" + "\n".join(lines) + "\n")
        line = refused("run", "case1", "--set", f"demand.file={path}", "--out", str(tmp_path / "out"))
        assert str(path) in line
        assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_made_is_bad_input(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert "is not a results folder" in refused("run", "case1", "--out", str(tmp_path / "out"))


def test_the_table_has_a_column_for_each_run_and_a_dash_for_what_it_lacks() -> None:
    lines = kpi_table(
        {"A": {"availability_pct": 99.5}, "B": {"availability_pct": 98.25, "revenue_eur": 3.0}}
    ).splitlines()
    assert lines[0].split() == ["A", "B"]
    assert lines[1] == "Money" and lines[3] == "Efficiency"
    assert lines[2].split() == ["Revenue", "EUR", "–", "3.00"]
    assert lines[4].split() == ["Availability", "%", "99.50", "98.25"]
    assert len({len(lines[index]) for index in (0, 2, 4)}) == 1


def test_a_study_with_the_objectives_of_the_paper_is_said_to_be_one() -> None:
    assert "except to reproduce the paper" in command("check", "case1").stdout
    quiet = ["--set", "policy.objectives.kind=energy"]
    assert "except to reproduce the paper" not in command("check", "case1", *quiet).stdout
    assert "except to reproduce the paper" not in command("check", "case1", "--set", "policy.name=soc").stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rn"], "Did you mean 'run'? (see bess --help)"),
        (["run", "case1", "--ot", "x"], "--ot (Possible options: --out, --set) (see bess run --help)"),
        (["run"], "Missing argument 'STUDY'. (see bess run --help)"),
        (["schema", "plant"], "'plant' is not one of 'study', 'system'. (see bess schema --help)"),
    ],
)
def test_what_was_mistyped_is_answered_in_one_line_with_the_help_that_applies(
    words: list[str], said: str
) -> None:
    assert refused(*words).endswith(said)


def test_a_file_missed_by_a_letter_is_named(tmp_path: Path) -> None:
    (tmp_path / "prices-2024.csv").touch()
    line = refused("check", "arbitrage-2024", "--set", "demand.prices=price-2024.csv", folder=tmp_path)
    assert "no such file; did you mean 'prices-2024.csv'?" in line


def test_the_next_command_can_be_copied_from_a_folder_with_blanks_in_its_name(tmp_path: Path) -> None:
    """``bess init`` names ``bess run``, which names ``bess report``."""
    words = ["init", "wind park/ä"]
    for more in (["--days", "0.125", "--set", "policy.name=equal", "--out", "first run"], ["--no-rules"]):
        said = command(*words, folder=tmp_path).stdout
        words = [*shlex.split(said[said.index(" bess ") :].rstrip(".\n"))[1:], *more]
    assert command(*words, folder=tmp_path).returncode == 0
    assert (tmp_path / "first run" / "report.html").exists()
