"""Claim: whatever a user gets wrong on the command line is one line on standard error and status 2."""

from __future__ import annotations

from pathlib import Path

import pytest

import bess
from commands import refused

ROWS = [f"2024-06-01T{hour:02d}:{minute:02d}Z,10" for hour in range(8) for minute in (0, 15, 30, 45)]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with things that are no input."""
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("file").write_text("x")
    Path("empty.csv").write_text("")
    Path("empty.toml").write_text("")
    Path("bytes.toml").write_bytes(bytes(range(256)))
    Path("broken.toml").write_text("a = = 1")
    Path("typo.toml").write_text('[demand]\nfile = "two-cycle-48h"\n[polcy]\nname = "equal"\n')
    return tmp_path


def of(*settings: str) -> list[str]:
    words = ["run", "case1", "--out", "out"]
    for setting in ("policy.name=equal", "run.days=0.25", *settings):
        words += ["--set", setting]
    return words


def with_row(index: int, row: str) -> list[str]:
    return [*ROWS[:index], row, *ROWS[index + 1 :]]


PROFILES = {
    "a short gap": (ROWS[:8] + ROWS[9:], "line 10: follows a gap of 0.25 h from 2024-06-01 02:00 UTC"),
    "a long gap": (ROWS[:8] + ROWS[20:], "follows a gap of 3 h"),
    "a coarser stretch": (ROWS[:8] + ROWS[8:24:4] + ROWS[24:], "follows a gap of 0.75 h"),
    "a repeated row": (ROWS[:9] + ROWS[8:], "line 11: repeats 2024-06-01 02:00 UTC of line 10"),
    "a NaN": (with_row(8, "2024-06-01T02:00Z,nan"), "follows a gap of 0.25 h"),
    "an empty value at the end": (with_row(31, "2024-06-01T07:45Z,"), "ends of the series are missing"),
    "an infinity": (with_row(8, "2024-06-01T02:00Z,inf"), "'inf' in column 'power_kw' is not a number"),
    "text": (with_row(8, "2024-06-01T02:00Z,ten"), "'ten' in column 'power_kw' is not a number"),
    "naive times": ([row.replace("Z", "") for row in ROWS], "has no time zone"),
    "mixed times": (with_row(8, "2024-06-01T02:00,10"), "mixed time zones"),
    "mixed offsets": (with_row(8, "2024-06-01T04:00+02:00,10"), "mixed time zones"),
    "descending times": (ROWS[::-1], "goes back to"),
    "one row": (ROWS[:1], "a series needs two"),
    "no rows": ([], "a header but no data"),
}


@pytest.mark.parametrize("what", PROFILES)
def test_a_profile_with(what: str) -> None:
    rows, expected = PROFILES[what]
    Path("load.csv").write_text("\n".join(["time,power_kw", *rows]) + "\n")
    line = refused(*of("demand.file=load.csv", "demand.repeat=false"))
    assert "load.csv" in line and expected in line
    with pytest.raises(bess.InputError, match=r"load\.csv"):
        study = bess.load_study("case1", {"demand.file": "load.csv", "policy.name": "equal"})
        bess.run(study.with_values({"demand.repeat": False, "run.days": 0.25}), progress=False)


@pytest.mark.parametrize(("fill", "filled"), [("previous", 10.0), ("interpolate", 15.0)])
def test_gaps_of_a_profile_are_filled_as_the_study_says(fill: str, filled: float) -> None:
    rows = [*ROWS[:8], *(row.replace(",10", ",20") for row in ROWS[9:])]
    Path("load.csv").write_text("\n".join(["time,power_kw", *rows]) + "\n")
    series = bess.load_study(
        "case1", {"demand.file": "load.csv", "demand.fill": fill, "policy.name": "equal", "run.days": 0.25}
    )
    demand = bess.run(series, progress=False).dataset["demand_kw"].values
    assert demand[7:10].tolist() == [10.0, filled, 20.0]


BAD_SETTINGS = {
    "run.days=-1": "run.days = -1: must be in (0, 36525] days",
    "run.days=0": "must be in (0, 36525] days",
    "run.days=nan": "must be a finite number",
    "run.days=0.251": "whole number of steps of 15 min",
    "run.days=soon": "run.days = 'soon'",
    "run.start=2024-01-01T00:00:00": "has no time zone",
    "run.start=9999-12-31T23:59:00Z": "ends after the year 9999",
    "run.plant_step_s=7": "plant_step_s 7 s does not divide the control step of 15 min",
    "run.plant_step_s=0": "run.plant_step_s = 0",
    "policy.horizon_steps=-3": "policy.horizon_steps = -3",
    "policy.horizon_steps=2.5": "policy.horizon_steps = 2.5",
    "policy.horizon_steps=four": "policy.horizon_steps = 'four'",
    "policy.name=magic": "no such policy; allowed: equal, priority",
    "policy.nam=equal": "did you mean 'policy.name'?",
    "polcy.name=equal": "polcy: unknown key; did you mean 'policy'?",
    "policy=3": "policy = 3: must be a table",
    "policy.name.x=3": "has no keys below it",
    "=3": "write key=value",
    "garbage": "write key=value",
    "...=1": "unknown key",
    "event.0.string=1": "event: must be a list",
    "system.initial_soc=1.5": "system.initial_soc = 1.5: must be in [0, 1]",
    "system.initial_soc=[0.5]": "1 values for 2 strings",
    "system.initial_temperature_c=500": "must be in [-60, 150] degC",
    "system.ambient_c=900": "must be in [-60, 150] degC",
    "system.n_strings=0": "system.n_strings = 0",
    "system.parameters.control.step_min=7": "whole number of steps of",
    "system.parameters.batery.r_scale=1": "unknown section 'batery'; did you mean 'battery'?",
    "system.parameters.initial_soc=1": "unknown section 'initial_soc'; it is a key of section 'system'",
    "system.file=nosuch": "system.file = 'nosuch': no bundled item has this name; allowed: reference",
    "system.file=referense": "did you mean 'reference'?",
    "system.file=nosuch.toml": "nosuch.toml: no such file",
    "system.file=./folder": "cannot be read",
    "system.file=./empty.toml": "battery.cells_series: missing",
    "system.file=./bytes.toml": "cannot be read",
    "demand.file=two-cycle-48": "did you mean 'two-cycle-48h'?",
    "demand.file=none.csv": "no such file",
    "demand.file=./folder": "cannot be read (a folder, not a file)",
    "demand.file=empty.csv": "the file is empty",
    "demand.file=./a\0b.csv": "cannot be read",
    "demand.scale=0": "must be in (0, 1e+06]",
    "demand.fill=guess": "demand.fill = 'guess'",
    "weather.file=./folder": "cannot be read (a folder, not a file)",
    "weather.file=empty.csv": "the file is empty",
    "policy.objectives.inverter=-1": "policy.objectives.inverter.weight = -1: must be in [0, 1e+06]",
    "event=[{string=7,start=2024-01-01T00:00:00Z,end=2024-01-02T00:00:00Z}]": "has strings 0 to 1",
    "event=[{string=0,start=2030-01-01T00:00:00Z,end=2030-01-02T00:00:00Z}]": "outside the run, 2024-01-01",
    "event=[{string=0,start=2024-01-01T00:00:00Z,end=2024-01-02T00:00:00Z,limit_kw=500}]": "0 has 92 kW",
}


@pytest.mark.parametrize("setting", BAD_SETTINGS)
def test_a_setting(setting: str) -> None:
    assert BAD_SETTINGS[setting] in refused(*of(setting))
    assert not Path("out").exists()


BAD_COMMANDS = {
    ("run", "caes1"): "did you mean 'case1'?",
    ("run", "folder"): "cannot be read",
    ("run", "none.toml"): "no such study; check the path",
    ("run", "empty.toml"): "demand: missing",
    ("run", "bytes.toml"): "cannot be read",
    ("run", "broken.toml"): "not valid TOML",
    ("run", "typo.toml"): "polcy: unknown key; did you mean 'policy'?",
    ("run", "a\0b.toml"): "cannot be read",
    ("check", "none.toml"): "no such study",
    ("report", "folder"): "holds no run",
    ("report", "file"): "holds no run",
    ("report", "nowhere"): "holds no run",
    ("run", "arbitrage-2024", "--set", "demand.prices=empty.csv"): "the file is empty",
    ("run", "arbitrage-2024", "--set", "demand.prices=./folder"): "cannot be read",
    ("run", "fcr-arbitrage", "--set", "demand.market_time_zone=Mars"): "= 'Mars': is no time zone; write a",
    ("run", "peak-shaving", "--set", "demand.billing_time_zone=Mars"): "= 'Mars': is no time zone; write a",
    ("run", "case1", "--out", "file"): "is not a results folder",
    ("run", "case1", "--out", "file/x"): "is not a results folder",
    ("run", "case2", "--out", "file"): "is not a results folder",
    ("run", "case1", "--resume"): "specify the folder of the run with --out",
    ("run", "case1", "--out", "nowhere", "--resume"): "nowhere contains no run to continue",
    ("run", "case1", "--out", "folder", "--resume"): "folder contains no run to continue",
}


@pytest.mark.parametrize("words", BAD_COMMANDS, ids=" ".join)
def test_a_command(words: tuple[str, ...]) -> None:
    quick = () if words[0] == "report" or words[1] != "case1" else ("--set", "policy.name=equal")
    assert BAD_COMMANDS[words] in refused(*words, *quick)


def test_demand_above_the_plant_is_split_at_full_power_and_the_rest_is_unmet() -> None:
    values = {"policy.name": "equal", "demand.scale": 10, "run.days": 0.25}
    data = bess.run(bess.load_study("case1", values), progress=False).dataset
    asked = abs(data["request_kw"].values.sum(axis=1))
    assert asked.max() == pytest.approx(184.0)
    assert data["unmet_kw"].values == pytest.approx(abs(data["demand_kw"].values) - asked)
