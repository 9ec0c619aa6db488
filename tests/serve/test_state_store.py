"""State on a disk that is full or hangs: the controller goes on, says so, and loses nothing whole."""

from __future__ import annotations

import resource
import threading
from pathlib import Path

import pytest
from live_cases import controller, measured

pytest.importorskip("fastapi")

from bess.edge.plant_io.journal import Journal, open_journal
from bess.edge.serve import run
from bess.edge.serve import state_store as module
from bess.edge.serve.answer import Demand
from bess.edge.serve.service import Service
from bess.edge.serve.state_store import StateStore
from bess.errors import InputError
from bess.study import load_study
from patient import PATIENT


def test_a_full_disk_never_spoils_both_files(tmp_path: Path) -> None:
    live = controller(2)
    memory = StateStore(tmp_path, live.system)
    live.step(measured([0.6, 0.5]), 100.0, 0.0)
    memory.save(live)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        for k in range(1, 4):
            live.step(measured([0.6, 0.5]), 100.0, 10.0 * k)
            memory.save(live)
            assert "the state cannot be written (" in memory.error
            assert "--" not in memory.error
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    again = controller(2)
    note = StateStore(tmp_path, live.system).load(again, 40.0)
    assert "continues with the state" in note
    assert again.answers == 1
    memory.save(live)
    assert memory.error == ""
    memory.close()


def test_a_disk_that_hangs_holds_one_answer_up_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "DISK_TIMEOUT_S", 0.0)
    study = load_study("policies", {"policy.name": "soc", **PATIENT})
    service = Service(study, tmp_path)
    hangs, goes_on = threading.Event(), threading.Event()

    def write(name: str, content: bytes) -> None:
        hangs.set()
        goes_on.wait()

    with monkeypatch.context() as disk:
        disk.setattr(service.memory, "_write", write)
        answers = [service.answer(measured([0.6, 0.5]), Demand(100.0)) for _ in range(5)]
    assert hangs.is_set()
    assert not any(answer.fallback for answer in answers)
    assert "the disk has not answered for" in service.memory.error
    assert service.health()["status"] != "ok"
    goes_on.set()
    service.close()


def test_a_journal_whose_disk_hangs_has_a_gap_and_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = controller(2)
    journal = Journal(tmp_path, live.system, "test")
    goes_on = threading.Event()
    with monkeypatch.context() as disk:
        disk.setattr(journal, "_write", lambda path, record: goes_on.wait())
        for _ in range(3):
            journal.append(measured([0.6, 0.5]), 100.0, [50.0, 50.0])
            assert "the disk does not answer" in journal.error
        goes_on.set()
        while journal._aside.busy_s > 0.0:
            pass
    journal.append(measured([0.6, 0.5]), 100.0, [50.0, 50.0])
    assert journal.error == ""
    journal.close()
    assert open_journal(tmp_path).sizes["time"] == 1


def test_a_journal_whose_header_is_damaged_keeps_no_service_from_starting(tmp_path: Path) -> None:
    live = controller(2)
    first = Journal(tmp_path, live.system, "test")
    first.append(measured([0.6, 0.5]), 100.0, [50.0, 50.0])
    first.close()
    (tmp_path / "journal.json").write_bytes(b"{")
    journal = Journal(tmp_path, live.system, "test")
    journal.append(measured([0.6, 0.5]), 100.0, [50.0, 50.0])
    assert "journal.json: is damaged" in journal.error
    journal.close()


def test_a_study_of_another_plant_that_is_refused_leaves_the_state_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "_log_to_standard_error", lambda: None)
    two, three = (load_study("policies", {"system.n_strings": n, "policy.name": "soc"}) for n in (2, 3))
    service = Service(two, tmp_path)
    service.answer(measured([0.5, 0.5]), Demand(10.0))
    service.close()
    Journal(tmp_path, service.controller.system, "two strings").close()
    address = "openems=http://127.0.0.1:1"
    with pytest.raises(InputError, match="of a plant of 2 strings, this one has 3"):
        run.serve(three, port=0, state=tmp_path, plant=address, simulated=True)
    again = Service(two, tmp_path)
    again.close()
    assert again.controller.answers == 1
