"""Claims about runs that are killed, interrupted, starved of disk, or resumed as something else."""

import errno
import itertools
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bess
import bess.simulation.record.provenance as identity_module
import bess.simulation.runner as run_module
from bess.checkpoints import from_json, to_json
from bess.simulation.record.store import locked
from bess.study import Study
from power_cut import PowerCut, before_steps, cut_off

pytestmark = pytest.mark.process

BESS = [sys.executable, "-m", "bess"]
LONG = {
    "policy.name": "soc",
    "run.days": 120,
    "demand.repeat": True,
    "system.initial_soc": [0.2, 0.7],
    "wear.model": "kokam-75ah",
}
PRICES = Path(__file__).parents[3] / "shared/data/prices/smard_de_viertelstunde_2024_berechnet_resaved.csv"


@pytest.fixture
def short() -> Study:
    return bess.load_study("case1", {"policy.name": "soc", "run.days": 0.5, "system.initial_soc": [0.3, 0.6]})


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "MAX_PART_STEPS", 16)


def assert_same(directory: Path, reference: bess.Result) -> None:
    """Dataset to the last bit; key figures but for the wall clock."""
    data = bess.open_result(directory)
    assert data.identical(reference.dataset)
    kpis = json.loads((directory / "kpis.json").read_text())
    assert {k: v for k, v in kpis.items() if not k.startswith("solve_time")} == {
        k: v for k, v in reference.kpis.items() if not k.startswith("solve_time")
    }
    lines = [json.loads(line) for line in (directory / "log.jsonl").read_text().splitlines()]
    worth_a_line = (data["solver_status"] != 0) | (data["unmet_kw"] > 0.0) | (data["fallback"] != 0)
    assert [line["step"] for line in lines] == np.flatnonzero(worth_a_line).tolist()
    for line in lines:
        assert set(line) >= {"step", "time", "status", "gap", "nodes", "solve_time_s", "fallback", "unmet_kw"}
    assert not (directory / "parts").exists()
    assert not list(directory.rglob("*.tmp"))


def test_the_log_has_a_line_only_where_there_is_something_to_say(tmp_path: Path) -> None:
    """Ten years under a rule would write 65 MB in which nothing was solved."""
    values = {"policy.name": "soc", "run.days": 2.0}
    bess.run(bess.load_study("case1", values), progress=False, out=tmp_path / "quiet")
    assert (tmp_path / "quiet/log.jsonl").read_text() == ""
    study = bess.load_study("case1", values | {"demand.scale": 3.0})
    much = bess.run(study, progress=False, out=tmp_path / "x")
    lines = [json.loads(line) for line in (tmp_path / "x/log.jsonl").read_text().splitlines()]
    assert len(lines) == int((much.dataset["unmet_kw"] > 0.0).sum()) > 0
    assert all(line["unmet_kw"] > 0.0 for line in lines)


def test_a_run_that_is_stopped_without_a_folder_says_once_that_nothing_is_kept(
    short: Study, small_parts: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    before_steps(monkeypatch, lambda steps: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(bess.StoppedEarly, match="results not saved") as caught:
        bess.run(short, progress=False)
    assert "is saved" not in "".join(traceback.format_exception(caught.value))


def test_an_optimised_run_continues_to_the_same_bits(
    small_parts: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study("case1", {"run.days": 0.5, "policy.horizon_steps": 4})
    reference = bess.run(study, progress=False)
    assert reference.kpis["solver_steps"] > 40
    cut_off(study, tmp_path / "run", 20, monkeypatch)
    bess.run(study, progress=False, out=tmp_path / "run", resume=True)
    assert_same(tmp_path / "run", reference)


def test_a_run_on_disk_is_the_run_in_memory(short: Study, small_parts: None, tmp_path: Path) -> None:
    result = bess.run(short, progress=False, out=tmp_path / "run")
    assert_same(tmp_path / "run", bess.run(short, progress=False))
    assert result.dataset.identical(bess.open_result(tmp_path / "run"))


def test_runs_in_threads_write_and_open_their_records(short: Study, tmp_path: Path) -> None:
    """In a process of its own, which a library that is not made for threads would end."""
    script = (
        "import sys, bess\n"
        "from concurrent.futures import ThreadPoolExecutor\n"
        "study = bess.load_study(sys.argv[1])\n"
        "expected = bess.run(study, progress=False).dataset\n"
        "def same(k):\n"
        "    folder = f'{sys.argv[2]}/{k}'\n"
        "    bess.run(study, progress=False, out=folder)\n"
        "    return bess.open_result(folder).load().identical(expected)\n"
        "with ThreadPoolExecutor(4) as pool:\n"
        "    assert all(pool.map(same, range(8)))\n"
    )
    (tmp_path / "short.toml").write_text(short.to_toml())
    subprocess.run([sys.executable, "-c", script, tmp_path / "short.toml", tmp_path / "runs"], check=True)


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_power_cut_at_any_write_loses_nothing(
    call: str, short: Study, small_parts: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process ends at the n-th flush or rename, for every n; a second run completes it."""
    reference = bess.run(short, progress=False)
    home = os if call == "fsync" else Path
    original = getattr(home, call)
    n = 0
    while True:
        calls = iter(range(n + 1))

        def cut(*arguments: Any, calls: Iterator[int] = calls) -> Any:
            if next(calls, None) == n:  # noqa: B023
                raise PowerCut
            return original(*arguments)

        directory = tmp_path / str(n)
        with monkeypatch.context() as patch:
            patch.setattr(home, call, cut)
            try:
                bess.run(short, progress=False, out=directory)
            except PowerCut:
                pass
            else:
                break
        if (directory / "log.jsonl").exists() and not (directory / "results.nc").exists():
            with (directory / "log.jsonl").open("a") as log:
                log.write('{"step": 1, "half a li')
        bess.run(short, progress=False, out=directory, resume=True)
        assert_same(directory, reference)
        n += 1
    assert n >= 7  # identity, study, three parts, results, key figures


def kill_until_done(command: list[str], directory: Path, kills: int, pause_s: Iterator[float]) -> int:
    """Run, kill -9 and resume ``kills`` times, then let it finish; return the kills that struck."""
    struck = 0
    for number in range(kills):
        resume = ["--resume"] if number else []
        process = subprocess.Popen([*command, *resume], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        begun = len(list((directory / "parts").glob("*.npz")))
        while process.poll() is None and len(list((directory / "parts").glob("*.npz"))) <= begun:
            time.sleep(0.002)
        time.sleep(next(pause_s))
        process.kill()
        struck += process.wait() == -signal.SIGKILL
    finished = subprocess.run([*command, "--resume"], capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    return struck


def command(directory: Path, values: dict[str, Any]) -> list[str]:
    settings = [part for key, value in values.items() for part in ("--set", f"{key}={json.dumps(value)}")]
    return [*BESS, "run", "case1", "--out", str(directory), *settings]


def test_kill_9_in_mid_run_and_resume_give_the_uninterrupted_result(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    pauses = iter([0.0, 0.05, 0.11])
    assert kill_until_done(command(directory, LONG), directory, 3, pauses) >= 2
    assert_same(directory, bess.run(bess.load_study("case1", LONG), progress=False))


@pytest.mark.slow
@pytest.mark.parametrize(("policy", "max_s"), [("mpc", 0.1), ("temperature", 0.005)])
def test_twenty_kills_of_a_run_of_two_weeks(policy: str, max_s: float, tmp_path: Path) -> None:
    """Each kill strikes at a random moment after the next part of 16 steps; each time the run is resumed."""
    values = {**LONG, "run.days": 14, "policy.name": policy, "output.node_temperatures": True}
    generator = random.Random(20240101)
    directory = tmp_path / "run"
    pauses = iter(lambda: generator.uniform(0.0, max_s), None)
    small = "import runpy, bess.simulation.runner as r; r.MAX_PART_STEPS = 16; runpy.run_module('bess')"
    words = [sys.executable, "-c", small, *command(directory, values)[len(BESS) :]]
    assert kill_until_done(words, directory, 20, pauses) == 20
    assert_same(directory, bess.run(bess.load_study("case1", values), progress=False))


@pytest.mark.slow
def test_three_years_of_ageing_survive_kills_to_the_last_bit(tmp_path: Path) -> None:
    values = {**LONG, "run.days": 1096, "system.initial_soh_capacity": [1.0, 0.9]}
    directory = tmp_path / "run"
    pauses = iter([0.0, 0.03, 0.1, 0.2])
    assert kill_until_done(command(directory, values), directory, 4, pauses) >= 2
    assert_same(directory, bess.run(bess.load_study("case1", values), progress=False))


def test_an_arbitrage_plan_under_way_survives_a_crash(
    small_parts: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not PRICES.exists():
        pytest.skip(f"{PRICES} is not there")
    values = {"policy.name": "soc", "demand.prices": str(PRICES), "run.days": 2, "demand.replan_h": 11.0}
    study = bess.load_study("arbitrage-2024", values)
    reference = bess.run(study, progress=False)
    cut_off(study, tmp_path / "run", 100, monkeypatch)
    assert bess.open_result(tmp_path / "run").sizes["time"] == 96
    bess.run(study, progress=False, out=tmp_path / "run", resume=True)
    assert_same(tmp_path / "run", reference)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_saves_exits_with_3_and_can_be_continued(number: signal.Signals, tmp_path: Path) -> None:
    directory = tmp_path / "run"
    values = {**LONG, "run.days": 300}
    process = subprocess.Popen(
        command(directory, values), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    while not list((directory / "parts").glob("*.npz")):
        assert process.poll() is None, process.stderr and process.stderr.read()
        time.sleep(0.005)
    process.send_signal(number)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 3, said
    message = said.strip().splitlines()[-1]
    assert "all is saved in" in message and "continue with resume" in message
    saved = bess.open_result(directory)
    assert 0 < saved.sizes["time"] < 300 * 96
    # What was saved is what the run would have had there.
    whole = bess.run(bess.load_study("case1", {**values, "run.days": 10}), progress=False).dataset
    steps = min(saved.sizes["time"], 960)
    np.testing.assert_array_equal(saved.soc.values[:steps], whole.soc.values[:steps])


def test_a_stop_between_two_looks_at_the_flag_still_saves_a_part(
    short: Study, small_parts: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop looks at the flag before and after each call of the plant; the stop comes after a look."""
    reference = bess.run(short, progress=False)
    for looks in (1, 2, 3, 4):
        answers = itertools.chain([False] * looks, itertools.repeat(True))
        with monkeypatch.context() as patch:
            patch.setattr(run_module, "stop_requests", lambda a=answers: nullcontext(lambda: next(a)))
            with pytest.raises(bess.StoppedEarly, match=r"stopped after step \d+ of 48"):
                bess.run(short, progress=False, out=tmp_path / str(looks))
        assert bess.open_result(tmp_path / str(looks)).sizes["time"] >= 1
    bess.run(short, progress=False, out=tmp_path / "1", resume=True)
    assert_same(tmp_path / "1", reference)


def test_a_full_disk_is_one_clear_error_and_nothing_is_lost(
    short: Study, small_parts: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = tmp_path / "run"
    write = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        if path.name.startswith("00000016"):
            write(path, content[: len(content) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return write(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(bess.BessError, match=r"the disk is full, make room.*resume"):
            bess.run(short, progress=False, out=directory)
    assert bess.open_result(directory).sizes["time"] == 16
    bess.run(short, progress=False, out=directory, resume=True)
    assert_same(directory, bess.run(short, progress=False))


@pytest.mark.parametrize("megabytes", [0.05, 0.3])
def test_a_real_limit_on_file_size_ends_in_one_line_and_status_1(megabytes: float, tmp_path: Path) -> None:
    """RLIMIT_FSIZE strikes the log in mid-run (50 kB) or the results file at the end (300 kB)."""
    directory = tmp_path / "run"
    values = {**LONG, "run.days": 10}
    limit = f"import resource, runpy, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); \
resource.setrlimit(resource.RLIMIT_FSIZE, ({int(megabytes * 1e6)}, -1)); runpy.run_module('bess')"
    words = command(directory, values)
    limited = [sys.executable, "-c", limit, *words[3:]]
    ended = subprocess.run(limited, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr
    assert "the disk is full" in ended.stderr.strip().splitlines()[-1]
    resumed = subprocess.run([*words, "--resume"], capture_output=True, text=True, check=False)
    assert resumed.returncode == 0, resumed.stderr
    assert_same(directory, bess.run(bess.load_study("case1", values), progress=False))


def begun(short: Study, directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave an unfinished run behind."""
    with monkeypatch.context() as patch:
        patch.setattr(run_module, "_assemble", lambda *_: (_ for _ in ()).throw(PowerCut()))
        with pytest.raises(PowerCut):
            bess.run(short, progress=False, out=directory)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"run.days": 2.0}, "study.run.days: 0.5 -> 2.0"),
        ({"policy.name": "equal"}, 'study.policy.name: "soc" -> "equal"'),
        ({"system.parameters.battery.r_scale": 1.1}, "system.battery.r_scale"),
    ],
)
def test_a_changed_study_or_system_is_refused_on_resume_saying_what_changed(
    values: dict[str, Any], expected: str, short: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(short, tmp_path / "run", monkeypatch)
    with pytest.raises(bess.InputError) as caught:
        bess.run(short.with_values(values), progress=False, out=tmp_path / "run", resume=True)
    assert expected in str(caught.value)


def test_a_changed_version_is_refused_on_resume(
    short: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(short, tmp_path / "run", monkeypatch)
    monkeypatch.setattr("bess.simulation.record.provenance.__version__", "99.0")
    with pytest.raises(bess.InputError, match=r'version: ".*" -> "99\.0"'):
        bess.run(short, progress=False, out=tmp_path / "run", resume=True)


def test_edited_code_is_refused_on_resume_naming_the_file(
    short: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(short, tmp_path / "run", monkeypatch)
    package = Path(bess.__file__).parent
    policy = package / "control" / "policies" / "rule.py"
    assert {"control/policies/rule.py", "plant/plant.py"} < set(identity_module._code())
    assert any(name.startswith("_core") for name in identity_module._code())
    original = identity_module._sha256
    monkeypatch.setattr(
        identity_module, "_sha256", lambda path: "edited" if path == policy else original(path)
    )
    with pytest.raises(bess.InputError, match=r'code\.control/policies/rule\.py: "[0-9a-f]{16}" -> "edited"'):
        bess.run(short, progress=False, out=tmp_path / "run", resume=True)


def test_a_changed_data_file_is_refused_on_resume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    profile = tmp_path / "load.csv"
    rows = [f"2024-06-01T{hour:02d}:{minute:02d}Z,10" for hour in range(2) for minute in (0, 15, 30, 45)]
    profile.write_text("time,power_kw\n" + "\n".join(rows) + "\n")
    values = {"demand.file": str(profile), "demand.repeat": False, "run.days": 2 / 24, "policy.name": "equal"}
    study = bess.load_study("case1", values)
    begun(study, tmp_path / "run", monkeypatch)
    profile.write_text(profile.read_text().replace(",10\n", ",11\n", 1))
    with pytest.raises(bess.InputError, match=r"files\..*load\.csv"):
        bess.run(study, progress=False, out=tmp_path / "run", resume=True)


def test_an_unfinished_run_needs_resume_and_a_finished_one_is_opened(
    short: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = tmp_path / "run"
    begun(short, directory, monkeypatch)
    with pytest.raises(bess.InputError, match="unfinished; continue with resume"):
        bess.run(short, progress=False, out=directory)
    first = bess.run(short, progress=False, out=directory, resume=True)
    stamp = (directory / "results.nc").stat().st_mtime_ns
    assert bess.run(short, progress=False, out=directory).kpis == first.kpis
    assert (directory / "results.nc").stat().st_mtime_ns == stamp
    with pytest.raises(bess.InputError, match="holds another run"):
        bess.run(short.with_values({"run.days": 2.0}), progress=False, out=directory)


def test_a_folder_with_other_things_is_left_alone(short: Study, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(bess.InputError, match=r"holds 'thesis\.tex' but no run"):
        bess.run(short, progress=False, out=tmp_path)
    with pytest.raises(bess.InputError, match="is not a results folder"):
        bess.run(short, progress=False, out=tmp_path / "thesis.tex")


def test_two_runs_cannot_share_a_folder(short: Study, tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(bess.InputError, match=rf"process \({os.getpid()}\) writes there"):
        bess.run(short, progress=False, out=tmp_path)


def test_a_damaged_part_is_an_error_not_a_wrong_result(
    short: Study, small_parts: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(short, tmp_path / "run", monkeypatch)
    part = sorted((tmp_path / "run" / "parts").iterdir())[1]
    content = bytearray(part.read_bytes())
    content[len(content) // 3] ^= 0xFF
    part.write_bytes(content)
    with pytest.raises(bess.BessError, match="damaged"):
        bess.run(short, progress=False, out=tmp_path / "run", resume=True)


@pytest.mark.parametrize("what", ["nothing", "file", "several"])
def test_opening_what_is_no_result_says_what_is_there(what: str, tmp_path: Path) -> None:
    directory = tmp_path / "run"
    expected = {
        "nothing": "no such folder",
        "file": "holds no run|no such folder",
        "several": "open one of S1",
    }[what]
    if what == "file":
        directory.write_text("")
    if what == "several":
        study = bess.load_study("case2", {"policy.name": "equal", "run.days": 0.25})
        results = bess.run_scenarios(study, progress=False, out=directory)
        assert list(results) == ["S1", "S2", "S3"]
        assert bess.open_result(directory / "S2").sizes["time"] == 24
        assert set(json.loads((directory / "kpis.json").read_text())) == {"S1", "S2", "S3"}
    with pytest.raises(bess.InputError, match=expected):
        bess.open_result(directory)


LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.text(),
    st.binary(),
    st.lists(st.floats(), max_size=5).map(lambda values: np.array(values, dtype=np.float64)),
)
TREES = st.dictionaries(
    st.text(), st.recursive(LEAVES, lambda inner: st.dictionaries(st.text(), inner), max_leaves=8)
)


def same(first: Any, second: Any) -> bool:
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, np.ndarray):
        return first.tobytes() == second.tobytes() and first.shape == second.shape
    return type(first) is type(second) and bool(first == second or (first != first and second != second))


def test_a_state_that_could_not_be_read_back_is_refused_when_it_is_saved() -> None:
    with pytest.raises(TypeError, match="a checkpoint cannot hold set"):
        to_json({"policy": {"strings": {0, 1}}})


@given(TREES)
def test_a_checkpoint_comes_back_to_the_last_bit(tree: dict[str, Any]) -> None:
    try:
        text = to_json(tree)
    except TypeError as error:
        assert re.search(r"cannot hold the key '\\x00(array|bytes)'", str(error))
    else:
        assert same(from_json(text), tree)


@pytest.mark.parametrize("mark", ["\0array", "\0bytes"])
def test_a_key_that_marks_an_array_is_refused_when_it_is_saved(mark: str) -> None:
    with pytest.raises(TypeError, match="cannot hold the key"):
        to_json({"policy": [{"strings": {mark: ""}}]})
