"""Small things that strangers stumbled over, each as it should be."""

import errno
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bess
from bess.simulation.record.files import clear_errors

QUICK = {"policy.name": "equal", "run.days": 0.25}


def test_a_study_is_run_by_its_name_or_path(tmp_path):
    (tmp_path / "mine.toml").write_text(
        '[demand]\nfile = "two-cycle-48h"\n[policy]\nname = "equal"\n[run]\ndays = 0.25\n'
    )
    by_path = bess.run(tmp_path / "mine.toml", progress=False)
    assert by_path.kpis == bess.run(str(tmp_path / "mine.toml"), progress=False).kpis
    assert list(bess.run_scenarios(tmp_path / "mine.toml", progress=False)) == ["mine"]
    with pytest.raises(bess.InputError, match="did you mean 'case1'"):
        bess.run("caes1")
    with pytest.raises(bess.InputError, match="a study of several runs"):
        bess.run("case2")


@pytest.mark.parametrize(
    "value", [{}, None, 3, "results", xr.Dataset(), xr.Dataset({"a": ("x", [1])}), pd.DataFrame()]
)
def test_kpis_of_something_else_say_what_they_want(value):
    with pytest.raises(bess.InputError, match=r"kpis needs a result of bess\.run or bess\.open_result.*not "):
        bess.kpis(value)


def test_errors_of_python_do_not_speak_of_the_command_line():
    for values in ({"polcy.name": "equal"}, {"policy.nam": "equal"}, {"run.dayz": 3}):
        with pytest.raises(bess.InputError) as caught:
            bess.load_study("case1", values)
        assert "--" not in str(caught.value)
    with pytest.raises(bess.InputError) as caught:
        bess.run("arbitrage-2024", progress=False)
    assert "--" not in str(caught.value) and "demand.prices" in str(caught.value)
    with pytest.raises(bess.InputError) as caught:
        bess.run("case1", resume=True)
    assert "--" not in str(caught.value)


@pytest.mark.parametrize(
    ("days", "nearest"),
    [(0.1, "0.09375 and 0.1041666667"), (0.001, "0.01041666667"), (1.003, "1 and 1.010416667")],
)
def test_days_that_are_no_whole_steps_come_with_the_nearest_that_are(days, nearest):
    with pytest.raises(bess.InputError, match=rf"nearest: {nearest}$"):
        bess.run(bess.load_study("case1", QUICK | {"run.days": days}), progress=False)
    for text in nearest.split(" and "):
        study = bess.load_study("case1", QUICK | {"run.days": float(text)})
        assert bess.run(study, progress=False).dataset.sizes["time"] >= 1


def test_a_name_that_ends_in_pdf_gives_a_pdf(tmp_path):
    figure_module = pytest.importorskip("matplotlib.figure")
    from bess.report import save_figure

    figure = figure_module.Figure()
    figure.subplots().plot([1, 2])
    save_figure(figure, tmp_path / "s.pdf")
    assert (tmp_path / "s.pdf").read_bytes()[:5] == b"%PDF-"
    assert not (tmp_path / "s.pdf.svg").exists()


@pytest.mark.parametrize("code", [errno.EACCES, errno.EROFS, errno.EPERM])
def test_a_folder_that_may_not_be_written_is_not_to_be_resumed(code):
    with pytest.raises(bess.BessError) as caught, clear_errors(Path("out")):
        raise OSError(code, os.strerror(code))
    assert "resume" not in str(caught.value) and "another folder" in str(caught.value)


def test_the_validation_predicts_a_log_without_a_charge(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples"))
    import thermal_validation as validation

    def measured(name, amps):
        n = amps.size
        soc = 0.99 - np.cumsum(amps) * 3.0 / 3600.0 / 31.0
        volts = 3.4 + 0.7 * soc - 0.001 * amps
        warm = 25.0 + np.linspace(0.0, 3.0, n)
        return validation.Measurement(
            name, amps, volts, soc, np.tile(warm, (3, 1)), np.full(n, 25.0), (amps, volts, soc)
        )

    with_charge = measured("1c", np.r_[np.full(1000, 30.0), np.zeros(50), np.full(1000, -29.0)])
    discharge = measured("new", np.full(900, 60.0))
    assert validation.has_charge(with_charge) and not validation.has_charge(discharge)
    monkeypatch.setattr(validation, "leaf_tests", lambda folder: [with_charge])
    monkeypatch.setattr(validation, "read", lambda *paths: discharge)
    monkeypatch.setattr(
        validation,
        "fit_plant",
        lambda tests: validation.cell_system(tests, specific_heat_j_kgk=1600.0, film_w_m2k=15.0),
    )
    monkeypatch.setattr(sys, "argv", ["x", "data", "--fit", "1", "--predict", "new.csv", "new.lvm"])
    validation.main()
    said = capsys.readouterr().out
    assert "strict" in said and "without a charge" in said


def test_a_row_of_a_profile_costs_some_string_calls_and_none_of_pandas(tmp_path):
    """Counted, not timed: 21 calls a row, where one element of a pandas series alone takes 47."""
    from bess.dispatch import read_profile

    def calls(rows: int) -> int:
        times = pd.date_range("2024-01-01", periods=rows, freq="min").strftime("%Y-%m-%d %H:%M:%S")
        path = tmp_path / f"{rows}.csv"
        pd.DataFrame({"time": times, "power": np.round(np.sin(np.arange(rows)), 3)}).to_csv(path, index=False)
        counted = 0

        def count(frame, event, argument):
            nonlocal counted
            counted += event in ("call", "c_call")

        sys.setprofile(count)
        try:
            read_profile(path, time_zone="UTC")
        finally:
            sys.setprofile(None)
        return counted

    calls(1_440)  # what is imported and compiled on first use
    assert calls(6_440) - calls(1_440) < 30 * 5_000


def test_what_is_no_result_is_named():
    with pytest.raises(bess.InputError, match="not SimpleNamespace"):
        bess.kpis(SimpleNamespace(dataset={}))


# --- nesting without an end --------------------------------------------------------------------------------

DEEP = {
    "lists": "[" * 200_000,
    "tables": '{"a":' * 200_000,
    "closed lists": "[" * 900 + "]" * 900,
    "keys": "a." * 20_000 + "a = 1\n",
}


@pytest.mark.parametrize("kind", DEEP)
@pytest.mark.parametrize("name", ["policy.json", "study.toml", "system.toml", "prices.json"])
def test_nesting_without_an_end_is_refused_wherever_a_document_is_read(name, kind, tmp_path):
    from bess.control.explicit import ExplicitController

    path = tmp_path / name
    path.write_text(DEEP[kind] if name.endswith("json") else f"a = {DEEP[kind]}\n{DEEP['keys']}")
    read = {
        "policy.json": ExplicitController.read,
        "study.toml": bess.load_study,
        "system.toml": bess.load_system,
        "prices.json": bess.read_prices,
    }
    with pytest.raises(bess.InputError):
        read[name](path)
    with pytest.raises(bess.InputError):
        bess.load_study("case1", {"a." * 2000 + "a": 1})


@pytest.mark.parametrize("name", ["run.json", "kpis.json", "log.jsonl", "study.toml"])
def test_nesting_without_an_end_in_a_folder_of_results_is_refused_or_does_not_matter(name, tmp_path):
    from bess.report.page import _title
    from bess.report.runs import runs_in
    from bess.simulation.record.files import CHECKSUMS

    study = bess.load_study("case1", QUICK)
    bess.run(study, out=tmp_path, progress=False)
    (tmp_path / CHECKSUMS).unlink()
    (tmp_path / name).write_text(DEEP["lists"])
    assert _title(tmp_path)
    for call in (lambda: runs_in(tmp_path), lambda: bess.run(study, out=tmp_path, progress=False)):
        try:
            call()
        except bess.InputError as error:
            assert name in str(error)


def test_a_part_of_a_giant_shape_is_damaged(tmp_path, monkeypatch):
    import io
    import zipfile

    from bess.simulation.record.files import sealed, unsealed
    from power_cut import cut_off

    study = bess.load_study("case1", QUICK)
    monkeypatch.setattr("bess.simulation.runner.MAX_PART_STEPS", 8)
    cut_off(study, tmp_path / "run", 20, monkeypatch)
    (path, *_) = sorted((tmp_path / "run/parts").glob("*.npz"))
    out = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(unsealed(path.read_bytes()))) as old,
        zipfile.ZipFile(out, "w") as new,
    ):
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b"(8,)", b"(" + b"9" * 15 + b",)"))
    path.write_bytes(sealed(out.getvalue()))
    with pytest.raises(bess.InputError, match="damaged"):
        bess.open_result(tmp_path / "run")


# --- the command line --------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["schema", "study"], ["check", "case1"], ["list"]])
def test_a_terminal_without_a_degree_sign_gets_the_rest(words):
    import subprocess

    environment = os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    command = [sys.executable, "-m", "bess", *words]
    ended = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert ended.returncode == 0 and ended.stdout.isascii(), ended.stderr


@pytest.mark.parametrize("start", ["2024-06-01T03:00:00Z", "2024-01-02T00:00:00Z", "2024-01-01T23:50:00Z"])
@pytest.mark.parametrize("key", ["demand.prices", "demand.file"])
def test_a_start_after_the_end_of_a_file_says_what_the_file_covers(key, start, tmp_path):
    times = pd.date_range("2024-01-01", periods=24, freq="h")
    column = {"demand.prices": "price", "demand.file": "power_kw"}[key]
    rows = "".join(f"{t:%Y-%m-%d %H:%M}Z,{50 + t.hour}\n" for t in times)
    (tmp_path / "t.csv").write_text(f"time,{column}\n{rows}")
    kind = {"demand.prices": "arbitrage", "demand.file": "profile"}[key]
    section, _, name = key.partition(".")
    study = {"name": "s", section: {"kind": kind, name: str(tmp_path / "t.csv")}, "run": {"start": start}}
    with pytest.raises(bess.InputError, match=r"run\.start = 2024-.*t\.csv covers 2024-01-01 00:00 to 2024"):
        bess.run(bess.Study.from_document(study, "s"), progress=False)


def test_a_word_that_is_no_utf_8_is_refused_before_a_run(tmp_path):
    import subprocess

    command = [
        sys.executable,
        "-m",
        "bess",
        "run",
        "case1",
        "--set",
        b"title=a\xff",
        "--out",
        tmp_path / "out",
    ]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1, ended.stderr
    assert not (tmp_path / "out").exists()
    with pytest.raises(bess.InputError, match="cannot be written as a study file"):
        bess.load_study("case1", {"system.parameters.battery.cell_mass_kg": 10**5000})
