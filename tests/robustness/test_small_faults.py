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
from bess.record.atomic import clear_errors

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
    with pytest.raises(bess.InputError, match=r"kpis needs what bess\.run or bess\.open_result gives.*not "):
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


def test_reading_costs_a_small_multiple_of_splitting_the_text_into_cells(tmp_path):
    import csv
    import time

    from bess.ems import read_profile

    rows = 60_000
    times = pd.date_range("2024-01-01", periods=rows, freq="min").strftime("%Y-%m-%d %H:%M:%S")
    path = tmp_path / "minutes.csv"
    pd.DataFrame({"time": times, "power": np.round(np.sin(np.arange(rows)), 3)}).to_csv(path, index=False)

    def cost(call):
        started = time.process_time()
        call()
        return time.process_time() - started

    def split():
        with path.open(newline="") as file:
            return list(csv.reader(file))

    least = min(cost(split) for _ in range(2))
    assert min(cost(lambda: read_profile(path, time_zone="UTC")) for _ in range(2)) < 20 * least


def test_what_is_no_result_is_named():
    with pytest.raises(bess.InputError, match="not SimpleNamespace"):
        bess.kpis(SimpleNamespace(dataset={}))
