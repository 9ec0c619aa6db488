"""Whatever a file, a folder, an array or a rule is: one sentence, no traceback, no hang."""

import gzip
import json
import os
import signal
import time
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import bess
from bess import files
from bess.arrays import real_numbers
from bess.control.policies import POLICIES
from bess.control.policies.rule import RulePolicy
from bess.dispatch import PerfectForecast, read_profile
from bess.study import expand
from bess.system.components import read_ocv
from commands import command

QUICK = {"policy.name": "equal", "run.days": 0.25}
READERS = {
    "prices": bess.read_prices,
    "weather": bess.read_weather,
    "profile": read_profile,
    "system": bess.load_system,
    "study": bess.load_study,
    "inverter": lambda path: bess.read_inverter(path, nominal_kw=92.0),
    "cell": read_ocv,
}


@pytest.fixture(autouse=True)
def no_hang():
    """A test that waits for a pipe is ended, and fails."""

    def ended(number, frame):
        raise TimeoutError("hangs")

    before = signal.signal(signal.SIGALRM, ended)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


# --- what is no file ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_is_refused_and_never_waited_for(reader, tmp_path):
    path = tmp_path / "pipe.csv"
    os.mkfifo(path)
    with pytest.raises(bess.InputError, match="pipe"):
        READERS[reader](path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no /dev/zero here")
@pytest.mark.parametrize("reader", READERS)
def test_a_device_without_an_end_is_refused(reader):
    with pytest.raises(bess.InputError, match=r"a pipe or a device|no such system file"):
        READERS[reader]("/dev/zero")


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", ["a\0b.csv", "x" * 300 + ".csv", "", ".", "nowhere/at/all.toml"])
def test_a_name_that_is_none_is_refused(reader, name):
    with pytest.raises(bess.InputError):
        READERS[reader](name)


@pytest.mark.parametrize("value", [None, 7, 1.5, [], object()])
def test_what_is_no_path_is_refused(value):
    for read in (bess.read_prices, bess.read_weather, read_profile, bess.run, bess.run_scenarios):
        with pytest.raises(bess.InputError):
            read(value)


CONTENTS = {
    "nothing": b"",
    "a mark of UTF-8": b"\xef\xbb\xbf",
    "a mark of UTF-16": b"\xff\xfe",
    "a mark and a line break": b"\xef\xbb\xbf\r\n",
    "blanks": b" \n\t\n ",
    "separators": b";;;\n;;;\n",
    "one letter": b"a",
    "one line": b"time,price\n",
    "zero bytes": bytes(2000),
    "all bytes": bytes(range(256)) * 4,
    "quotes": b'"' * 999,
    "an open quote": b'time,price\n"2024-01-01T00:00Z,1\n2024-01-01T01:00Z,2\n',
    "carriage returns": b"time,price\r2024-01-01T00:00Z,1\r2024-01-01T01:00Z,2\r",
    "a long line": b"x" * 300_000,
    "a long cell": b"time,price\n" + b"9" * 200_000 + b",1\n",
    "a huge integer": b"time,price\n2024-01-01T00:00Z," + b"9" * 5000 + b"\n2024-01-01T01:00Z,2\n",
    "deep JSON": b"[" * 100_000,
    "deep TOML": b"a = " + b"[" * 5000,
    "zip": b"PK\x03\x04" + bytes(50),
    "gzip": b"\x1f\x8b" + bytes(50),
    "parquet": b"PAR1" + bytes(50) + b"PAR1",
    "pdf": b"%PDF-1.7 ...",
    "xls": b"\xd0\xcf\x11\xe0" + bytes(500),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("what", CONTENTS)
def test_content_that_is_no_table_is_one_sentence(reader, what, tmp_path):
    path = tmp_path / "input.csv"
    path.write_bytes(CONTENTS[what])
    try:
        READERS[reader](path)
    except bess.InputError as error:
        assert "\n" not in str(error) and 10 < len(str(error)) < 3000
    else:
        assert what == "carriage returns"


# --- bombs -------------------------------------------------------------------------------------------------


@pytest.fixture
def small_limit(monkeypatch):
    """One MiB is too much, so that the test writes little."""
    from bess.market import files as market_files

    monkeypatch.setattr(files.limited, "__defaults__", (2**20,))
    monkeypatch.setattr(files.read_file, "__defaults__", (2**20,))
    monkeypatch.setattr(market_files, "MAX_BYTES", 2**20)


def test_archives_that_unpack_to_more_than_the_limit_are_refused(small_limit, tmp_path):
    many = b"time,price\n" + b"2024-01-01T00:00Z,1\n" * 100_000
    (tmp_path / "a.gz").write_bytes(gzip.compress(many))
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", many)
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", many)
    (tmp_path / "a.csv").write_bytes(many)
    for name in ("a.gz", "a.zip", "a.xlsx", "a.csv"):
        with pytest.raises(bess.InputError, match="more than 1 MiB"):
            bess.read_prices(tmp_path / name)


def test_the_limit_is_above_what_people_have():
    assert 100 * 2**20 < files.MAX_BYTES < 2**30


def test_an_archive_with_a_password_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a.csv", "time,price\n")
    raw = bytearray((tmp_path / "a.zip").read_bytes())
    for mark, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        raw[raw.index(mark) + flags] |= 1
    (tmp_path / "a.zip").write_bytes(raw)
    with pytest.raises(bess.InputError, match=r"cannot be unpacked .*password"):
        bess.read_prices(tmp_path / "a.zip")


def test_parquet_without_rows_or_with_odd_columns_is_refused(tmp_path):
    times = pd.date_range("2024-01-01", periods=3, freq="h", tz="UTC")
    empty = pd.DataFrame({"price": pd.Series(dtype=float)}, index=pd.DatetimeIndex([], tz="UTC"))
    frames = {
        "rows": empty,
        "columns": pd.DataFrame(index=times),
        "text": pd.DataFrame({"price": ["a", "b", "c"]}, index=times),
        "flags": pd.DataFrame({"price": [True, False, True]}, index=times),
        "times": pd.DataFrame({"price": [1.0, 2.0, 3.0]}),
        "missing": pd.DataFrame({"time": [times[0], pd.NaT, times[2]], "price": [1.0, 2.0, 3.0]}),
    }
    for name, frame in frames.items():
        frame.to_parquet(tmp_path / name)
        for read in (bess.read_prices, bess.read_weather, read_profile):
            with pytest.raises(bess.InputError):
                read(tmp_path / name)


# --- systems and studies -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "system = [true]", "string = [0.5]", "string = 5", "[[string]]\nsystem = 3", "battery = [1, 2]",
        "inverter = 'x'", "[system]\nn_strings = 'many'", "[system]\nn_strings = 1000000000",
        "[system]\nn_strings = 1e400", "control = []", "about = 1", "[battery]\ncell = []",
        "[inverter]\nmodel = {}", "[[string]]\nbattery = 7", "[thermal]\nspatial = 1",
    ],
)  # fmt: skip
def test_a_system_of_odd_types_is_one_sentence_in_a_study_too(text, tmp_path):
    (tmp_path / "plant.toml").write_text(text)
    for values in ({}, {"system.initial_soc": 0.5}, {"system.n_strings": 2}):
        study = bess.load_study("case1", QUICK | values | {"system.file": str(tmp_path / "plant.toml")})
        with pytest.raises(bess.InputError, match=r"plant\.toml"):
            bess.run(study, progress=False)
    settings = ["--set", f"system.file={tmp_path / 'plant.toml'}", "--set", "policy.name=equal"]
    ended = command("check", "case1", *settings)
    assert ended.returncode == 2 and len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "axis",
    [
        {"key": "run.days", "start": 1.0, "stop": 2.0, "count": 1_000_000_000},
        {"key": "run.days", "start": 1.0, "stop": 2.0, "count": 10**400},
        {"simplex": ["policy.objectives.inverter", "policy.objectives.battery"], "divisions": 10_000},
        {"simplex": [f"policy.objectives.{k}" for k in "abcdef"], "divisions": 9_000},
    ],
)
def test_a_sweep_of_a_billion_points_is_refused_at_once(axis):
    document = {"name": "s", "demand": {"file": "two-cycle-48h"}, "sweep": [axis, axis | {}, axis | {}]}
    started = time.process_time()
    with pytest.raises(bess.InputError):
        expand(bess.Study.from_document(document, "s"))
    assert time.process_time() - started < 5.0


def test_a_folder_of_an_impossible_name_is_refused(tmp_path):
    for name in ("a\0b", "x" * 300, str(tmp_path / ("y" * 300))):
        for call in (bess.run, bess.run_scenarios):
            with pytest.raises(bess.InputError, match="not a results folder"):
                call(bess.load_study("case1", QUICK), out=name, progress=False)
        ended = command("run", "case1", "--out", name, "--set", "policy.name=equal")
        assert ended.returncode == 2


# --- damaged results ---------------------------------------------------------------------------------------

DAMAGES = {
    "cut": lambda raw: raw[: len(raw) // 2],
    "empty": lambda raw: b"",
    "noise": lambda raw: bytes(np.random.default_rng(1).integers(0, 256, len(raw), dtype=np.uint8)),
    "text": lambda raw: b'{"a": ["b"]}',
    "list": lambda raw: b"[1, 2]",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "case1"
    bess.run(bess.load_study("case1", QUICK), out=folder, progress=False)
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", ["results.nc", "kpis.json", "run.json", "log.jsonl", "study.toml"])
def test_a_damaged_result_is_one_sentence_or_does_not_matter(name, damage, finished, tmp_path):
    for file, raw in finished.items():
        (tmp_path / file).write_bytes(DAMAGES[damage](raw) if file == name else raw)
    calls = [
        lambda: bess.open_result(tmp_path).load(),
        lambda: bess.run(bess.load_study("case1", QUICK), out=tmp_path, progress=False),
    ]
    for call in (*calls, lambda: looked_at(tmp_path)):
        try:
            call()
        except bess.InputError as error:
            assert str(tmp_path) in str(error) and "\n" not in str(error)


def looked_at(folder):
    """What a report reads of a run."""
    from bess.report.runs import runs_in

    runs, _ = runs_in(folder)
    for run in runs.values():
        assert run.kpis and run.study_toml is not None and run.dataset.load() is not None
        assert run.solve_time_s is None or run.solve_time_s.size


@pytest.mark.slow
@pytest.mark.parametrize("name", ["results.nc", "kpis.json", "run.json", "log.jsonl", "study.toml"])
def test_a_report_of_a_damaged_result_is_one_sentence_or_drawn(name, finished, tmp_path):
    for damage in DAMAGES.values():
        for file, raw in finished.items():
            (tmp_path / file).write_bytes(damage(raw) if file == name else raw)
        ended = command("report", str(tmp_path))
        assert ended.returncode in (0, 2) and len(ended.stderr.splitlines()) <= 1


def test_damaged_key_figures_are_made_again_from_the_record(finished, tmp_path):
    for file, raw in finished.items():
        (tmp_path / file).write_bytes(b"{" if file == "kpis.json" else raw)
    bess.run(bess.load_study("case1", QUICK), out=tmp_path, progress=False)
    assert json.loads((tmp_path / "kpis.json").read_text())["availability_pct"] == 100.0


# --- arrays ------------------------------------------------------------------------------------------------

ODD_ARRAYS = {
    "complex": np.array([0.5 + 1j, 0.5]),
    "a huge integer": [10**400, 0.5],
    "texts": ["0.5", "0.5"],
    "truth values": [True, False],
    "times": np.array(["2024-01-01", "2024-01-02"], dtype="M8[s]"),
    "durations": np.array([1, 2], dtype="m8[s]"),
    "masked": np.ma.masked_array([0.5, 0.5], [True, False]),
    "ragged": [[0.5], [0.5, 0.4]],
    "nothing": [None, 0.5],
    "objects": [object(), 0.5],
    "a dictionary": {"a": 1},
}
SYSTEM = bess.System.reference(2)
STATE = bess.State([0.5, 0.5], [25.0, 25.0])


@pytest.mark.parametrize("kind", ODD_ARRAYS)
def test_arrays_that_are_no_real_numbers_are_refused(kind):
    values = ODD_ARRAYS[kind]
    plant = bess.Plant(SYSTEM, STATE)
    with pytest.raises(ValueError):
        real_numbers(values)
    for call in (
        lambda: bess.State(values, [25.0, 25.0]),
        lambda: bess.State([0.5, 0.5], values),
        lambda: plant.step(values, step_s=900.0),
        lambda: plant.step([1.0, 1.0], step_s=900.0, ambient_c=values),
        lambda: plant.run(values, step_s=900.0),
        lambda: PerfectForecast(values),
        lambda: bess.inverter_from_efficiency(values, discharge=[95.0, 96.0], nominal_kw=9.0),
        lambda: bess.inverter_from_efficiency([0.1, 1.0], discharge=values, nominal_kw=9.0),
    ):
        with pytest.raises(bess.InputError):
            call()


def test_numbers_of_any_real_kind_are_taken():
    for values in ([1, 2], (1.0, 2), np.array([1, 2], np.int8), pd.Series([1, 2]), [np.float32(1), 2**70]):
        assert real_numbers(values).dtype == np.float64
    assert real_numbers([]).size == 0


# --- rules -------------------------------------------------------------------------------------------------

WRONG_RULES = {
    "one power for all": (lambda system, task: task.demand_kw, r"shape \(\), needs \(2,\)"),
    "a string too many": (lambda system, task: np.zeros(3), r"shape \(3,\), needs \(2,\)"),
    "a table": (lambda system, task: np.zeros((2, 1)), r"shape \(2, 1\), needs \(2,\)"),
    "nothing": (lambda system, task: None, "ValueError: NoneType is not a number"),
    "texts": (lambda system, task: ["a", "b"], "texts are not numbers"),
    "too much": (lambda system, task: np.full(2, 1e3), "this is an error of the policy"),
    "not a number": (lambda system, task: np.full(2, np.nan), "this is an error of the policy"),
    "an exception": (lambda system, task: [][1], "IndexError: list index out of range"),
}


@pytest.mark.parametrize("kind", WRONG_RULES)
def test_a_rule_that_returns_something_else_is_named_with_its_step(kind, monkeypatch):
    rule, said = WRONG_RULES[kind]
    factory = (lambda system, settings: RulePolicy(system, settings.dt_h, rule), kind)
    monkeypatch.setitem(POLICIES, "strange", factory)
    with pytest.raises(bess.BessError, match=rf"policy 'strange', step 0: .*{said}"):
        bess.run(bess.load_study("case1", QUICK | {"policy.name": "strange"}), progress=False)
