"""A driven plant under every fault that links, plants and machines have been seen with.

In none of them is power sent in the wrong direction, beyond a limit, or zero by accident; after each the
plant follows again within two control steps.
"""

import itertools
import resource
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest
from plant_partners import N, Rig

from bess.edge.plant_io import calls, link
from bess.edge.plant_io.journal import open_journal
from bess.edge.plant_io.simulated_openems import SimulatedEdge

LAPSE_STEPS = 12
"""Control steps after which whatever lapses has lapsed, and what cannot be changed is forgotten."""
DISCHARGE_KW, CHARGE_KW = 150.0, -140.0
"""Two strings of three can give either, one cannot."""


@dataclass(frozen=True)
class Fault:
    """How it begins and ends, and whether the others can carry the demand meanwhile."""

    begin: Callable[[Rig], Any]
    end: Callable[[Rig], Any]
    carried: bool


def _of_string(name: str) -> Fault:
    """Return a fault of the string that carries most."""
    return Fault(
        lambda rig: getattr(rig.watched.plant.faults, name).add(
            int(np.argmax(np.abs(rig.watched.power_kw())))
        ),
        lambda rig: getattr(rig.watched.plant.faults, name).clear(),
        True,
    )


def _say_kilowatts(rig: Rig) -> None:
    rig.watched.plant.faults.kilowatts = True


def _say_watts(rig: Rig) -> None:
    rig.watched.plant.faults.kilowatts = False


def _restart(rig: Rig) -> None:
    rig.partner.stop()
    rig.partner.start()


def _set_slow(rig: Rig) -> None:
    """Answers take longer than is waited for; less is waited for than otherwise, for the sake of the test."""
    rig.monkeypatch.setattr(calls, "DEADLINE_S", 0.2)
    rig.watched.plant.faults.delay_s = 0.4


def _set_fast(rig: Rig) -> None:
    rig.monkeypatch.setattr(calls, "DEADLINE_S", 3.0)
    rig.watched.plant.faults.delay_s = 0.0


FAULTS = {
    "link lost": Fault(lambda rig: rig.partner.stop(), lambda rig: rig.partner.start(), False),
    "slow": Fault(_set_slow, _set_fast, False),
    "wrong units": Fault(_say_kilowatts, _say_watts, False),
    "a string undefined": _of_string("undefined"),
    "a string silent": _of_string("silent"),
    "a string dead": _of_string("dead"),
    "a string frozen": _of_string("frozen"),
    "a string hung": _of_string("hung"),
    "a string deaf": _of_string("deaf"),
    "a string severed": _of_string("severed"),
    "restarted": Fault(_restart, _restart, True),
}


@pytest.mark.parametrize(("before_kw", "after_kw"), [(DISCHARGE_KW, CHARGE_KW), (CHARGE_KW, DISCHARGE_KW)])
@pytest.mark.parametrize("name", FAULTS)
def test_no_fault_sends_what_should_not_be_sent(
    rig: Rig, name: str, before_kw: float, after_kw: float
) -> None:
    fault = FAULTS[name]
    rig.ask(before_kw)
    rig.step(3)
    assert rig.follows()

    fault.begin(rig)
    rig.step(2)
    rig.ask(after_kw)  # the worst moment to go on with what was
    rig.step(LAPSE_STEPS)
    assert rig.broken == []
    if fault.carried:
        assert rig.follows(), rig.cycle.trouble
    else:
        assert rig.power_kw() == 0.0
        assert rig.cycle.trouble != ""

    fault.end(rig)
    rig.step(2)
    assert rig.follows(), rig.cycle.trouble
    assert rig.broken == []
    assert rig.cycle.trouble == ""


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("deaf", "does not follow"),
        ("frozen", "its state of charge has been constant at"),
        ("hung", "for any set-point"),
        ("dead", "out of service"),
    ],
)
def test_a_string_that_cannot_be_trusted_is_named(rig: Rig, fault: str, sentence: str) -> None:
    rig.ask(DISCHARGE_KW)
    rig.step(3)
    FAULTS[f"a string {fault}"].begin(rig)
    (victim,) = getattr(rig.watched.plant.faults, fault)
    seen = set()
    for _ in range(60):
        rig.step()
        answer = rig.service.last[-1]  # type: ignore[index]
        seen |= {string for string, reason in enumerate(answer.reasons) if sentence in reason}
        if seen:
            break
    assert seen == {victim}
    rig.step()
    assert rig.follows()
    assert rig.broken == []


def test_a_string_that_is_cut_off_from_what_answers_for_it_is_not_missed(rig: Rig) -> None:
    rig.ask(DISCHARGE_KW)
    rig.step(3)
    FAULTS["a string severed"].begin(rig)  # every value stays as it should be, as the demand does
    (victim,) = rig.watched.plant.faults.severed
    rig.step(LAPSE_STEPS)
    assert rig.watched.plant.holds(victim) is None
    assert rig.follows()
    reason = rig.service.last[-1].reasons[victim]  # type: ignore[index]
    known = (
        "says the plant" if isinstance(rig.partner, SimulatedEdge) else "its heartbeat has been constant at"
    )
    assert known in reason
    FAULTS["a string severed"].end(rig)
    rig.step(2)
    assert rig.follows()
    assert rig.watched.plant.holds(victim) is not None
    assert rig.broken == []


@pytest.mark.parametrize("fault", ["silent", "undefined"])
def test_a_string_that_does_not_answer_and_still_flows_is_made_up_for(rig: Rig, fault: str) -> None:
    rig.ask(DISCHARGE_KW)
    rig.step(3)
    FAULTS[f"a string {fault}"].begin(rig)
    (victim,) = getattr(rig.watched.plant.faults, fault)
    rig.step()
    rig.ask(DISCHARGE_KW - 30.0)
    rig.step()
    still_kw = rig.watched.power_kw()[victim]
    if fault == "silent":  # it keeps its set-point: nothing reaches it
        assert still_kw > 50.0
        assert rig.service.health()["out_of_control_kw"] == pytest.approx(still_kw, abs=1.0)
        assert rig.power_kw() == pytest.approx(DISCHARGE_KW - 30.0, abs=1.0)
    rig.step(LAPSE_STEPS)
    assert rig.follows()
    assert rig.broken == []


def test_a_plant_that_is_cut_off_as_a_whole_is_let_go(rig: Rig) -> None:
    rig.ask(DISCHARGE_KW)
    rig.step(3)
    rig.watched.plant.faults.severed |= set(range(N))
    rig.step(LAPSE_STEPS)
    assert rig.power_kw() == 0.0
    assert "no string is in service" in rig.cycle.trouble
    rig.watched.plant.faults.severed.clear()
    rig.step(2)
    assert rig.follows()
    assert rig.broken == []


@pytest.mark.parametrize("partner", ["openems"], indirect=True)  # Modbus knows no password
def test_a_wrong_password_stops_writing_and_a_right_one_starts_it_again(rig: Rig) -> None:
    assert isinstance(rig.partner, SimulatedEdge)
    rig.ask(DISCHARGE_KW)
    rig.step(2)
    rig.partner.password = "changed"
    rig.step(LAPSE_STEPS)
    assert rig.power_kw() == 0.0
    assert "BESS_PLANT_PASSWORD" in rig.cycle.trouble
    rig.partner.password = "owner"
    rig.step(2)
    assert rig.follows()
    assert rig.broken == []


@pytest.mark.parametrize("jump_s", [-86_400.0, -0.5, 3_600.0, 1e9])
def test_a_machine_whose_clock_is_set_drives_on(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, jump_s: float
) -> None:
    class Jumping(datetime):
        offset = timedelta(0)

        @classmethod
        def now(cls, tz: Any = None) -> datetime:
            return datetime.now(tz) + cls.offset

    monkeypatch.setattr(link, "datetime", Jumping)
    rig.ask(DISCHARGE_KW)
    rig.step(2)
    Jumping.offset = timedelta(seconds=jump_s)
    for _ in range(4):
        rig.step()
        assert rig.follows()
    Jumping.offset = timedelta(0)
    rig.step(2)
    assert rig.follows()
    assert rig.broken == []


def test_a_full_disk_stops_nobody(rig: Rig) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    rig.ask(DISCHARGE_KW)
    rig.step(2)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        rig.ask(CHARGE_KW)
        rig.step(3)
        followed = rig.follows()
        said = rig.service.memory.error
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert followed
    assert said != ""
    rig.step(2)
    assert rig.follows()
    assert rig.service.memory.error == ""
    assert open_journal(rig.journal).sizes["time"] >= 3
    assert rig.broken == []


def test_no_demand_is_not_a_demand_of_zero(rig: Rig) -> None:
    rig.ask(DISCHARGE_KW)
    rig.step(2)
    rig.demands.post(DISCHARGE_KW, 0.0, rig.service.clock())
    rig.watched.asked.clear()
    rig.cycle.step()
    assert rig.watched.asked == []
    assert [rig.watched.plant.holds(string) for string in range(N)] == [None] * N


def test_two_faults_at_once_are_no_worse_than_each(rig: Rig) -> None:
    for first, second in itertools.combinations(("a string dead", "link lost", "slow", "wrong units"), 2):
        rig.ask(DISCHARGE_KW)
        rig.step(3)
        assert rig.follows(), (first, second, rig.cycle.trouble)
        FAULTS[first].begin(rig)
        FAULTS[second].begin(rig)
        rig.ask(CHARGE_KW)
        rig.step(2)
        FAULTS[first].end(rig)
        rig.step(2)
        FAULTS[second].end(rig)
        rig.step(2)
        assert rig.follows(), (first, second, rig.cycle.trouble)
        rig.ask(DISCHARGE_KW)
        rig.step(2)
    assert rig.broken == []
