"""Two controllers at one plant: the other is named, one gives way, and the plant does not swing."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from plant_partners import STEP_S, Connecting, N, Partner, Rig, Watched

from bess.edge.plant_io.journal import Journal
from bess.edge.plant_io.simulated_openems import SimulatedEdge
from bess.edge.serve.control_loop import ControlLoop, Demands
from bess.edge.serve.service import Service
from bess.study import Study

ONE_KW, OTHER_KW = -150.0, 150.0


@pytest.fixture
def other(
    rig: Rig, partner: Partner, connecting: Connecting, watched: Watched, tmp_path: Path
) -> Iterator[tuple[ControlLoop, Demands, Service]]:
    """A second service at the plant of the rig, with the same clock."""
    study = Study.from_document(
        {
            "name": "other",
            "system": {"n_strings": N},
            "demand": {"file": "two-cycle-48h"},
            "policy": {"name": "soc"},
            "service": {"control_step_s": STEP_S},
        },
        "the other service",
    )
    service = Service(study, tmp_path / "other")
    service.clock = rig.service.clock  # type: ignore[method-assign]
    demands = Demands(study, 900.0)
    journal = Journal(tmp_path / "other", service.controller.system, "other")
    cycle = ControlLoop(service, connecting(partner.address), demands, journal, monotonic=watched.clock)
    yield cycle, demands, service
    journal.close()
    service.close()


def test_of_two_services_one_names_the_other_and_gives_way(
    rig: Rig, other: tuple[ControlLoop, Demands, Service]
) -> None:
    cycle, demands, service = other
    rig.demands.post(ONE_KW, 86_400.0, rig.service.clock())
    demands.post(OTHER_KW, 86_400.0, service.clock())
    troubles: list[set[str]] = [set(), set()]
    totals = []
    for _ in range(60):
        for one, seen in zip((rig.cycle, cycle), troubles, strict=True):
            one.step()
            seen.add(one.trouble)
            rig.clock.now_s += STEP_S / 2
            totals.append(rig.power_kw())
    told = "it does not follow" if isinstance(rig.partner, SimulatedEdge) else "set-point read back"
    said = "".join(troubles[0] | troubles[1])
    assert "another controller writes to string" in said
    assert told in said
    last = np.array(totals[-60:])
    assert np.unique(np.sign(last)).tolist() in ([-1.0], [1.0])
    assert last == pytest.approx(last[0], abs=0.1)
    assert abs(last[0]) == pytest.approx(150.0, abs=0.1)


def test_a_string_that_somebody_else_drives_is_left_to_them_and_taken_up_when_it_rests(rig: Rig) -> None:
    rig.demands.post(100.0, 86_400.0, rig.service.clock())
    rig.step(3)
    (their,) = [int(np.argmax(rig.watched.power_kw()))]
    plant = rig.watched.plant
    for _ in range(12):
        plant.ask(their, -60.0, rig.clock.now_s + 3.0 * STEP_S)
        rig.step()
    assert rig.watched.power_kw()[their] == pytest.approx(-60.0, abs=0.1)
    assert f"another controller writes to string {their}" in rig.cycle.trouble
    answer = rig.service.last[-1]  # type: ignore[index]
    assert not answer.in_service[their]
    assert np.delete(rig.watched.power_kw(), their).sum() == pytest.approx(100.0, abs=0.1)
    rig.step(60)
    assert rig.cycle.trouble == ""
    assert rig.service.last[-1].in_service.all()  # type: ignore[index]
    assert rig.power_kw() == pytest.approx(100.0, abs=0.1)


@pytest.mark.parametrize("fault", ["deaf", "dead"])
def test_a_string_that_gives_nothing_is_not_taken_for_another_controller(rig: Rig, fault: str) -> None:
    said = set()
    for demand_kw in (150.0, 150.0, 150.0, -140.0, -140.0, 150.0):
        rig.demands.post(demand_kw, 86_400.0, rig.service.clock())
        for _ in range(10):
            rig.step()
            said |= {rig.cycle.trouble, *rig.service.last[-1].reasons}  # type: ignore[index]
            getattr(rig.watched.plant.faults, fault).add(0)
    assert not any("another controller" in sentence for sentence in said)
