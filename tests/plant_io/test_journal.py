"""The journal of a plant: nothing said before is lost, and nothing that goes wrong stops who writes it."""

import gzip
import os
import resource
import shutil
import signal
import subprocess
import sys
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.edge.plant_io import Measurements
from bess.edge.plant_io.journal import Journal, is_journal, open_journal
from bess.errors import InputError

SYSTEM = bess.System.reference(n_strings=2)
START = datetime(2026, 11, 21, 23, 59, 50, tzinfo=UTC)


def _said(second: float, power_kw: float = 10.0) -> Measurements:
    both = np.array([power_kw, -power_kw])
    return Measurements(
        time=START + timedelta(seconds=second),
        soc=np.array([0.5, np.nan]),
        temperature_c=np.array([25.0, 30.0]),
        power_kw=both,
        charge_limit_kw=np.array([92.0, np.inf]),
        discharge_limit_kw=np.array([92.0, 0.0]),
        available=np.array([True, False]),
    )


def test_what_is_appended_is_what_is_read_over_midnight_and_restarts(tmp_path: Path) -> None:
    assert not is_journal(tmp_path)
    with closing(Journal(tmp_path, SYSTEM, "a plant")) as journal:
        for second in range(0, 15, 5):
            journal.append(_said(second, power_kw=second), 78.0, [50.0, 28.0], [50.0, 27.0])
    with closing(Journal(tmp_path, SYSTEM, "a plant")) as journal:
        journal.append(_said(15), -78.0, [-50.0, -28.0])
        assert journal.error == ""
    assert is_journal(tmp_path)
    data = open_journal(tmp_path)
    assert data.sizes == {"time": 4, "string": 2}
    assert data["time"].values[-1] == np.datetime64("2026-11-22T00:00:05", "ms")
    assert data["power_kw"].values[:, 1].tolist() == [0.0, -5.0, -10.0, -10.0]
    assert data["demand_kw"].values.tolist() == [78.0, 78.0, 78.0, -78.0]
    assert data["recommended_kw"].values[-1].tolist() == [-50.0, -28.0]
    assert data["written_kw"].values[0].tolist() == [50.0, 27.0]
    assert np.isnan(data["written_kw"].values[-1]).all()
    assert np.isnan(data["soc"].values[:, 1]).all()
    assert np.isinf(data["charge_limit_kw"].values[:, 1]).all()
    assert data["available"].values.tolist() == [[1, 0]] * 4
    assert data.attrs["title"] == "a plant"
    assert all(data[name].attrs["units"] for name in data.data_vars)


def test_a_clock_that_was_set_back_leaves_times_that_rise(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        for second, power in ((0, 1), (10, 2), (5, 3), (10, 4), (20, 5)):
            journal.append(_said(second, power), 0.0, [0.0, 0.0])
    data = open_journal(tmp_path)
    assert (np.diff(data["time"].values) > np.timedelta64(0)).all()
    assert data["power_kw"].values[:, 0].tolist() == [1.0, 3.0, 4.0, 5.0]


def test_a_torn_record_is_not_read_and_not_continued(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(0), 1.0, [0.0, 0.0])
    (file,) = (tmp_path / "journal").iterdir()
    with file.open("ab") as torn:
        torn.write(b"half a record")
    assert open_journal(tmp_path).sizes["time"] == 1
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(1), 2.0, [0.0, 0.0])
    assert open_journal(tmp_path)["demand_kw"].values.tolist() == [1.0, 2.0]


def test_a_full_disk_stops_nobody_and_costs_only_what_it_must(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(0), 0.0, [0.0, 0.0])
        (file,) = (tmp_path / "journal").iterdir()
        resource.setrlimit(resource.RLIMIT_FSIZE, (file.stat().st_size + 20, hard))  # a part of the next fits
        try:
            journal.append(_said(1), 1.0, [0.0, 0.0])
            assert "has a gap" in journal.error
            journal.append(_said(2), 2.0, [0.0, 0.0])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        journal.append(_said(3), 3.0, [0.0, 0.0])
        assert journal.error == ""
    assert open_journal(tmp_path)["demand_kw"].values.tolist() == [0.0, 3.0]


def test_a_folder_that_vanished_is_an_error_that_passes(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(0), 0.0, [0.0, 0.0])
        journal._close_day()
        shutil.rmtree(tmp_path / "journal")
        journal.append(_said(1), 1.0, [0.0, 0.0])
        assert "cannot be written (No such file or directory)" in journal.error
        journal.append(_said(2), 2.0, [0.0, 0.0])
        assert journal.error == ""
    assert open_journal(tmp_path)["demand_kw"].values.tolist() == [2.0]


def test_days_take_no_more_than_they_may_and_what_is_left_is_read(tmp_path: Path) -> None:
    max_mb, n_days, day_s = 0.02, 150, 86_400.0
    with closing(Journal(tmp_path, SYSTEM, "", max_mb)) as journal:
        for day in range(n_days):
            for second in range(10):
                journal.append(_said(day * day_s + 10.0 + second), float(day), [0.0, 0.0])
        assert journal.error == ""
    files = sorted((tmp_path / "journal").iterdir())
    assert sum(file.stat().st_size for file in files[:-1]) <= 1e6 * max_mb
    assert [file.suffix for file in files] == [".gz"] * (len(files) - 1) + [".bin"]
    data = open_journal(tmp_path)
    days = np.unique(data["demand_kw"].values)
    assert len(days) == len(files) > 20
    assert days.tolist() == list(range(n_days - len(days), n_days))
    assert data.sizes["time"] == 10 * len(days)


def test_days_that_a_killed_process_left_unpacked_are_read_and_packed(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(0), 1.0, [0.0, 0.0])
    folder = tmp_path / "journal"
    (file,) = folder.iterdir()
    full = file.rename(folder / "2026-11-21.0.full")
    (folder / "2026-11-21.0.gz.tmp").write_bytes(b"half")
    assert open_journal(tmp_path).sizes["time"] == 1
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(5), 2.0, [0.0, 0.0])  # the clock was set back to that day
        journal.append(_said(86_400), 3.0, [0.0, 0.0])
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["2026-11-21.0.gz", "2026-11-21.1.gz", "2026-11-22.bin"]
    assert open_journal(tmp_path)["demand_kw"].values.tolist() == [1.0, 2.0, 3.0]
    # Killed between both names of the same content.
    full.write_bytes(gzip.decompress((folder / "2026-11-21.0.gz").read_bytes()))
    assert open_journal(tmp_path).sizes["time"] == 3


def test_a_packed_day_that_is_damaged_is_named(tmp_path: Path) -> None:
    with closing(Journal(tmp_path, SYSTEM, "")) as journal:
        journal.append(_said(0), 1.0, [0.0, 0.0])
        journal.append(_said(60), 1.0, [0.0, 0.0])
    (packed,) = (tmp_path / "journal").glob("*.gz")
    whole = packed.read_bytes()
    for content in (b"nothing", whole[:-12], whole[:20] + bytes(8) + whole[28:]):
        packed.write_bytes(content)
        with pytest.raises(InputError, match=r"2026-11-21.0.gz: cannot be read"):
            open_journal(tmp_path)


@pytest.mark.process
def test_kill_9_loses_nothing_that_was_appended(tmp_path: Path) -> None:
    code = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_journal import SYSTEM, Journal, Path, _said
journal = Journal(Path({str(tmp_path)!r}), SYSTEM, "")
for second in range(10**6):
    journal.append(_said(second), float(second), [0.0, 0.0])
    print(second, flush=True)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if int(line) == 200:
            os.kill(process.pid, signal.SIGKILL)
            break
    said = [int(line) for line in process.stdout]
    process.wait()
    demand = open_journal(tmp_path)["demand_kw"].values
    assert demand.tolist() == list(range(len(demand)))
    assert len(demand) >= max([200, *said]) + 1
    process.stdout.close()


def test_another_plant_is_not_continued(tmp_path: Path) -> None:
    Journal(tmp_path, SYSTEM, "").close()
    with pytest.raises(InputError, match="plant of 2 strings, this one has 3"):
        Journal(tmp_path, bess.System.reference(n_strings=3), "")


def test_what_is_no_journal_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no journal"):
        open_journal(tmp_path)
    Journal(tmp_path, SYSTEM, "").close()
    with pytest.raises(InputError, match="the journal is empty"):
        open_journal(tmp_path)
    for content in (
        "",
        "[]",
        '{"format": 2}',
        '{"format": 1, "n_strings": -1}',
        '{"format": 1, "n_strings": 2}',
    ):
        (tmp_path / "journal.json").write_text(content)
        with pytest.raises(InputError, match=r"journal.json: is damaged"):
            open_journal(tmp_path)
    with closing(Journal(tmp_path / "journal.json", SYSTEM, "")) as nowhere:
        assert "cannot be written (File exists)" in nowhere.error or "Not a directory" in nowhere.error
