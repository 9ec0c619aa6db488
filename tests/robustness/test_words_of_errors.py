"""Claim: an error reads the same in Python and on the command line, and names no keyword and no flag."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import bess
from bess.report import write_report
from bess.report.page import write_comparison
from bess.simulation.sweep import run_scenario, run_scenarios
from commands import command

STUDY = bess.load_study("case1", {"run.days": 0.25, "policy.name": "equal"})


@pytest.fixture
def full(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    bess.run(STUDY, out=folder, progress=False)
    return folder


def _damaged(folder: Path) -> None:
    (folder / "run.json").write_text("{")
    bess.run(STUDY, out=folder, progress=False)


CALLS: dict[str, Callable[[Path], object]] = {
    "another run": lambda folder: bess.run(STUDY.with_values({"run.days": 0.5}), out=folder, progress=False),
    "other files": lambda folder: bess.run(STUDY, out=folder.parent, progress=False),
    "a file": lambda folder: bess.run(STUDY, out=folder / "results.nc", progress=False),
    "several into one": lambda folder: run_scenarios(STUDY, out=folder, progress=False),
    "a comparison": lambda folder: write_comparison({}, folder),
    "identity": lambda folder: _damaged(folder),
}


@pytest.mark.parametrize("name", CALLS)
def test_errors_name_the_output_folder(name: str, full: Path) -> None:
    with pytest.raises(bess.BessError, match="folder") as caught:
        CALLS[name](full)
    assert "--" not in str(caught.value) and "out=" not in str(caught.value)


def test_the_command_line_and_workers_say_the_same(full: Path) -> None:
    said = command("run", "case1", "--days", "0.5", "--out", str(full))
    assert said.returncode == 2
    assert "use another output folder" in said.stderr
    assert "use another output folder" in run_scenario(STUDY.with_values({"run.days": 0.5}), full).error


def test_nothing_of_python_speaks_of_flags() -> None:
    package = Path(bess.__file__).parent
    said = [
        f"{path.relative_to(package)}: {line.strip()}"
        for path in package.rglob("*.py")
        if path.parts[-2] not in ("cli", "words") and path.name not in ("errors.py", "keys.py", "sections.py")
        for line in path.read_text().splitlines()
        if "--out" in line or "--resume" in line or "--set" in line
    ]
    assert said == []
    assert write_report.__doc__ is not None and "``out``" in write_report.__doc__
