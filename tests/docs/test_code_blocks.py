"""What the README and the documentation show runs as it stands."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import bess
from bess.cli.studies import findings
from bess.control.policies import POLICIES
from bess.simulation.runner import MAX_PART_S, MAX_PART_STEPS
from bess.study.study import Study

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
BLOCK = re.compile(r"^```(python|toml|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
STUDY = {"demand": {"file": "two-cycle-48h", "repeat": True}}


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")) if kind == language]


def having(language: str) -> list[pytest.param]:
    return [pytest.param(page, id=str(page.relative_to(ROOT))) for page in PAGES if blocks(page, language)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder with the files that the pages speak of; policies are as before afterwards."""
    times = pd.date_range("2024-01-01", periods=96, freq="15min", tz="UTC")
    price = pd.DataFrame({"time": times.strftime("%Y-%m-%dT%H:%M:%SZ"), "DE-LU": np.linspace(20.0, 90.0, 96)})
    price.to_csv(tmp_path / "prices.csv", index=False)
    levels = {f"p{share}": price["DE-LU"] + share for share in (10, 50, 90)}
    pd.DataFrame({"time": price["time"], **levels}).to_csv(tmp_path / "bands.csv", index=False)
    quarters = price["DE-LU"].to_numpy()
    quotes = pd.DataFrame(
        {"Date": times.strftime("%d/%m/%Y %H:%M"), "Intraday Auction 15 minute call": quarters}
    )
    quotes["Intraday Continuous 15 minutes ID3-Price"] = quarters[::-1]
    quotes.to_csv(tmp_path / "energy-charts.csv", index=False)
    for name in ("load", "panels"):
        pd.DataFrame({"time": price["time"], "power_kw": quarters}).to_csv(
            tmp_path / f"{name}.csv", index=False
        )
    load = np.linspace(0.1, 1.0, 10)
    pd.DataFrame({"load": load, "charge": 0.95 + 0.02 * load, "discharge": 0.955 + 0.02 * load}).to_csv(
        tmp_path / "sinamics.csv", index=False
    )
    sandia = (
        "Name,Paco,Pdco,Vdco,Pso,C0,C1,C2,C3,Pnt\nMPS-100,100000,104000,600,1500,-5e-8,1e-5,1e-3,-1e-4,30\n"
    )
    (tmp_path / "cec-inverters.csv").write_text(sandia)
    hours = pd.date_range("2023-12-31 23:00", "2025-01-02", freq="h", tz="UTC").strftime("%Y-%m-%dT%H:%M:%SZ")
    columns = {"SMARD": "DE-LU", "WEATHER": "temperature", "load": "power_kw", "panels": "power_kw"}
    for file, column in columns.items():
        values = 20.0 + 10.0 * np.sin(np.arange(len(hours)) / 4.0)
        pd.DataFrame({"time": hours, column: values}).to_csv(tmp_path / f"{file}.csv", index=False)
    day = pd.DataFrame({"time": times.strftime("%d.%m.%Y %H:%M"), "power": np.linspace(-80.0, 80.0, 96)})
    day.to_csv(tmp_path / "profile.csv", index=False)
    (tmp_path / "ocv.csv").write_text("SOC,OCV\n0,3.2\n0.5,3.7\n1,4.1\n")
    (tmp_path / "hysteresis.csv").write_text("SOC,HystV\n0,0.01\n1,0.01\n")
    titles = [f"R_{way}(T = {kelvin}K)" for way in ("Ch", "DCh") for kelvin in (288.15, 308.15)]
    rows = ["SOC," + ",".join(titles), "0,2.0,1.2,2.1,1.3", "1,1.5,0.9,1.6,1.0"]
    (tmp_path / "resistance.csv").write_text("\n".join(rows) + "\n")
    monkeypatch.chdir(tmp_path)
    registered = dict(POLICIES)
    yield tmp_path
    POLICIES.clear()
    POLICIES.update(registered)


@pytest.mark.parametrize("page", having("python"))
def test_python_of_a_page_runs_in_its_order(page: Path, folder: Path) -> None:
    namespace = {"__name__": "__main__"}
    for text in blocks(page, "python"):
        exec(compile(text, str(page), "exec"), namespace)


@pytest.mark.parametrize("page", having("toml"))
def test_toml_of_a_page_is_a_study_with_nothing_wrong_or_part_of_a_system(page: Path, folder: Path) -> None:
    for text in blocks(page, "toml"):
        document = tomllib.loads(text)
        if "string" in document:
            assert bess.System(bess.System.reference(2).document | document).n_strings == 2
        else:
            *_, last = findings(Study.from_document({"name": page.stem, **STUDY, **document}, page.name))
            assert last.endswith("no problems found")


def test_the_page_on_long_runs_says_how_much_a_crash_can_cost() -> None:
    text = (ROOT / "docs" / "howto" / "long-runs.md").read_text(encoding="utf-8")
    assert f"every {MAX_PART_STEPS} steps or every {MAX_PART_S:g} s" in text


@pytest.mark.parametrize("page", having("sh"))
def test_commands_of_a_page_exist_with_their_options(page: Path) -> None:
    from typer.main import get_command

    from bess.cli.app import app

    commands = get_command(app).commands
    for text in blocks(page, "sh"):
        for line in text.replace("\\\n", " ").splitlines():
            words = line.split("#")[0].split()
            if words[:1] == ["make"]:
                assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), line
            if words[:1] != ["bess"] or words[1].startswith("-"):
                continue
            known = {option for parameter in commands[words[1]].params for option in parameter.opts}
            assert {word for word in words[2:] if word.startswith("--")} <= known, line
