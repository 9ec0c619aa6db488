"""The page of a journal: sums and means from every reading, and gaps that stay gaps."""

from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.edge.plant_io import Measurements
from bess.edge.plant_io.journal import Journal, open_journal
from bess.edge.plant_io.journal_page import MAX_BINS, Losses, in_bins, modelled_losses, write_journal_report
from commands import command

SYSTEM = bess.System.reference(n_strings=2)
START = datetime(2026, 11, 21, tzinfo=UTC)


def _append(
    journal: Journal, second: float, did: list[float], recommended: list[float], soc: float = 0.6
) -> None:
    said = Measurements(
        time=START + timedelta(seconds=second),
        soc=np.full(2, soc),
        temperature_c=np.full(2, 25.0),
        power_kw=np.array(did),
        charge_limit_kw=np.full(2, 92.0),
        discharge_limit_kw=np.full(2, 92.0),
        available=np.isfinite(did),
    )
    journal.append(said, float(np.nansum(recommended)), recommended)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with closing(Journal(tmp_path, SYSTEM, "A plant that was watched")) as journal:
        for second in range(0, 7200, 10):
            if not 3000 <= second < 3600:
                _append(journal, second, [20.0, 20.0 if second < 5400 else np.nan], [40.0, 0.0])
    return tmp_path


def test_bins_are_means_and_leave_gaps_open(folder: Path) -> None:
    binned = in_bins(open_journal(folder))
    assert binned.sizes["time"] <= MAX_BINS
    steps = np.diff(binned["time"].values)
    assert (steps == steps[0]).all()
    seconds = (binned["time"].values - binned["time"].values[0]) / np.timedelta64(1, "s")
    gap = (seconds >= 3000) & (seconds < 3600)
    assert np.isnan(binned["power_kw"].values[gap]).all()
    assert (binned["power_kw"].values[~gap, 0] == 20.0).all()
    assert np.isnan(binned["power_kw"].values[seconds >= 5400, 1]).all()


def test_a_day_of_seconds_becomes_few_bins_with_the_same_mean(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        for second in range(20_000):
            _append(journal, second, [float(second % 50), 0.0], [0.0, 0.0])
    journal_ = open_journal(tmp_path)
    binned = in_bins(journal_)
    assert 0.3 * MAX_BINS < binned.sizes["time"] <= MAX_BINS
    assert binned["power_kw"].values[:, 0].mean() == pytest.approx(24.5, abs=0.2)


def test_losses_are_those_of_the_control_model_where_both_serve_the_same_demand(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        for second in range(0, 3600, 10):
            _append(journal, second, [20.0, 20.0], [40.0, 0.0])
        for second in range(3600, 5400, 10):
            _append(journal, second, [20.0, 20.0], [90.0, 0.0])  # another demand: not compared
        for second in range(5400, 6000, 10):
            _append(journal, second, [60.0, -20.0], [40.0, 0.0])  # both ways at once: not compared
    losses = modelled_losses(in_bins(open_journal(tmp_path)), SYSTEM)
    assert losses is not None
    state = bess.State(soc=[0.6, 0.6], temperature_c=[25.0, 25.0])
    for kwh, split in ((losses.did_kwh, [[20.0], [20.0]]), (losses.recommended_kwh, [[40.0], [0.0]])):
        roll = bess.rollout(SYSTEM, state, split, dt_h=10 / 3600)
        assert kwh == pytest.approx((roll.inverter_loss_kw + roll.battery_loss_kw).sum(), rel=1e-3)
    assert (losses.hours, losses.of_hours) == pytest.approx((1.0, 6000 / 3600))


def test_the_page_says_what_was_watched_and_what_was_missing(folder: Path) -> None:
    page = write_journal_report(folder).read_text(encoding="utf-8")
    assert "A plant that was watched" in page
    assert "Shadow mode: no set-point was written." in page
    assert "1 gap of 610 s" in page
    assert "String 1 was out of service in 27.3 % of the readings." in page
    assert sorted(path.name for path in (folder / "figures").glob("*.svg")) == [
        "plant.svg",
        "split.svg",
        "state.svg",
    ]


def test_a_journal_of_many_megawatts_has_plain_numbers(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        for second in range(0, 3600, 10):
            _append(journal, second, [50_000.0, 20_000.0], [75_000.0, 0.0])
    page = write_journal_report(tmp_path).read_text(encoding="utf-8")
    assert "70,000 discharged + 0 charged" in page
    assert "by 22,638 kW (rms)" in page
    assert "e+0" not in Losses(12_345.6, 12_000.0, 8760.0, 8784.0).sentence()


def test_report_and_export_know_a_journal(folder: Path) -> None:
    for word in ("report", "export"):
        done = command(word, str(folder))
        assert (done.returncode, done.stderr) == (0, "")
    rows = (folder / "record.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + open_journal(folder).sizes["time"]
    assert rows[0].startswith("time,demand_kw,power_kw.0")


def test_a_journal_of_one_reading_is_shown(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        _append(journal, 0, [np.nan, np.nan], [0.0, 0.0])
    assert write_journal_report(tmp_path).exists()
