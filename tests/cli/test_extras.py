"""A library that only some need may be missing: one sentence then names the extra that brings it."""

import subprocess
import sys
from pathlib import Path

import pytest

EVERY = "matplotlib bokeh jinja2 distributed dask pyarrow openpyxl fastapi uvicorn httpx pymodbus cma"
"""Libraries of the extras."""
WITHOUT = """
import sys
for name in {missing!r}.split():
    sys.modules[name] = None
from bess.cli import main
sys.argv = ["bess", *{words!r}]
main()
"""


def run_without(missing: str, *words: str) -> subprocess.CompletedProcess[str]:
    script = WITHOUT.format(missing=missing, words=words)
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("missing", "words", "extra"),
    [
        ("matplotlib", ["report", "{folder}"], "report"),
        ("distributed pyarrow", ["sweep", "case2", "--out", "{folder}/sweep"], "sweep"),
        (
            "pyarrow",
            ["check", "arbitrage-2024", "--set", "demand.prices={folder}/prices.parquet"],
            "market",
        ),
    ],
)
def test_a_missing_library_is_named_with_its_extra(
    missing: str, words: list[str], extra: str, tmp_path: Path
) -> None:
    (tmp_path / "prices.parquet").write_bytes(b"PAR1" + bytes(100))
    ended = run_without(missing, *(word.format(folder=tmp_path) for word in words))
    assert ended.returncode == 2, ended.stderr
    (line,) = ended.stderr.strip().splitlines()
    assert f"pip install 'bess-powersplit[{extra}]'" in line


def test_a_closed_loop_needs_none_of_the_extras(tmp_path: Path) -> None:
    missing = "matplotlib bokeh jinja2 distributed dask pyarrow"
    out = str(tmp_path / "out")
    ended = run_without(missing, "run", "case1", "--days", "0.125", "--out", out)
    assert ended.returncode == 0, ended.stderr
    assert "Demand fulfilment" in ended.stdout


def test_a_sweep_in_sequence_needs_none_of_the_extras(tmp_path: Path) -> None:
    import bess

    axis = {"key": "policy.name", "values": ["equal", "soc"]}
    study = bess.load_study("case1", {"run.days": 0.125, "sweep": [axis]})
    (tmp_path / "study.toml").write_text(study.to_toml())
    out = tmp_path / "out"
    ended = run_without("distributed dask pyarrow", "run", str(tmp_path / "study.toml"), "--out", str(out))
    assert ended.returncode == 0, ended.stderr
    assert (out / "sweep.csv").exists() and not (out / "sweep.parquet").exists()


@pytest.mark.parametrize(
    "module", ["bess", "bess.report", "bess.cli.records", "bess.edge.plant_io", "bess.simulation.record"]
)
def test_the_documentation_of_the_package_is_there_without_its_extras(module: str) -> None:
    script = (
        "import sys, pydoc\n"
        f"for name in {EVERY!r}.split():\n    sys.modules[name] = None\n"
        f"sys.argv = ['pydoc', {module!r}]\npydoc.cli()\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ended.returncode == 0 and not ended.stderr, ended.stderr
    assert f"Help on package {module}" in ended.stdout or f"Help on module {module}" in ended.stdout
    assert "problem in" not in ended.stdout


@pytest.mark.parametrize("words", [["report", "{run}/soc"], ["compare", "{run}/soc", "{run}/equal"]])
def test_every_command_that_draws_names_the_extra(words: list[str], tmp_path: Path) -> None:
    import bess

    for policy in ("soc", "equal"):
        study = bess.load_study("case1", {"policy.name": policy, "run.days": 0.125})
        bess.run(study, out=tmp_path / policy, progress=False)
    ended = run_without("matplotlib", *(word.format(run=tmp_path) for word in words))
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.count("\n") == 1 and "pip install 'bess-powersplit[report]'" in ended.stderr
