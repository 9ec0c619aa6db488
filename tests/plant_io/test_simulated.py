"""The simulated plant: what it does between two looks, and what it says when something is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from plant_partners import N, Watched

import bess
from bess.edge.plant_io.simulated import SimulatedPlant
from bess.edge.plant_io.simulated_openems import SimulatedEdge
from bess.edge.plant_io.simulated_sunspec import SimulatedDevices
from bess.errors import InputError


def _soc(plant: SimulatedPlant) -> np.ndarray:
    return np.array([reading.soc for reading in plant.truth()])


def test_a_set_point_lapses_at_its_time_even_if_nobody_looks_until_long_after(watched: Watched) -> None:
    expected = bess.Plant(watched.plant.system, watched.plant.system.initial_state(), plant_step_s=1.0)
    expected.step([92.0, 0.0, 0.0], 60.0)
    watched.plant.ask(0, 92.0, lapses_at=60.0)
    watched.clock.now_s = 3600.0
    assert _soc(watched.plant)[0] == pytest.approx(expected.state.soc[0], abs=1e-12)


def test_it_is_the_same_plant_however_often_one_looks(watched: Watched) -> None:
    seldom = SimulatedPlant(watched.plant.system, clock=watched.clock)
    for plant in (watched.plant, seldom):
        plant.ask(1, -50.0, np.inf)
    for _ in range(90):
        watched.clock.now_s += 0.7
        watched.plant.readings()
    assert _soc(watched.plant) == pytest.approx(_soc(seldom), abs=1e-12)


def test_speed_lets_an_hour_pass_in_a_minute(watched: Watched) -> None:
    fast = SimulatedPlant(watched.plant.system, speed=60.0, clock=watched.clock)
    fast.ask(0, 46.0, np.inf)
    watched.plant.ask(0, 46.0, np.inf)
    watched.clock.now_s += 60.0
    after_a_minute = _soc(fast)
    watched.clock.now_s += 3540.0
    assert after_a_minute == pytest.approx(_soc(watched.plant), abs=1e-9)


@pytest.mark.parametrize("speed", [0.0, -1.0, np.inf, np.nan])
def test_a_speed_must_be_a_positive_number(watched: Watched, speed: float) -> None:
    with pytest.raises(InputError, match="expected a positive number"):
        SimulatedPlant(watched.plant.system, speed=speed)


def test_a_clock_that_jumps_back_stops_the_plant_and_nothing_else(watched: Watched) -> None:
    watched.plant.ask(0, 46.0, np.inf)
    watched.clock.now_s += 600.0
    before = _soc(watched.plant)
    watched.clock.now_s -= 300.0
    assert _soc(watched.plant).tolist() == before.tolist()
    watched.clock.now_s += 600.0
    assert _soc(watched.plant)[0] < before[0]


def test_more_than_nominal_power_is_cut_by_the_inverter(watched: Watched) -> None:
    watched.plant.ask(0, 500.0, np.inf)
    watched.plant.ask(1, -500.0, np.inf)
    assert watched.power_kw() == pytest.approx([92.0, -92.0, 0.0])


def test_a_dead_string_says_so_and_a_deaf_one_does_not(watched: Watched) -> None:
    for string in range(N):
        watched.plant.ask(string, 50.0, np.inf)
    watched.plant.faults.dead.add(0)
    watched.plant.faults.deaf.add(1)
    said = watched.plant.readings()
    assert [said[string].power_kw for string in range(N)] == pytest.approx([0.0, 0.0, 50.0])
    assert [said[string].fault for string in range(N)] == [True, False, False]
    assert said[1].discharge_limit_kw == pytest.approx(92.0)


def test_a_frozen_string_says_its_old_state_and_a_hung_one_says_all_as_before(watched: Watched) -> None:
    before = watched.plant.readings()
    watched.plant.faults.frozen.add(0)
    watched.plant.faults.hung.add(1)
    for string in (0, 1):
        watched.plant.ask(string, 92.0, np.inf)
    watched.clock.now_s += 600.0
    said = watched.plant.readings()
    assert (said[0].soc, said[0].hottest_c) == (before[0].soc, before[0].hottest_c)
    assert said[0].power_kw == pytest.approx(92.0)
    assert said[1] == replace(before[1], beat=600)
    assert (_soc(watched.plant)[:2] < before[0].soc - 0.05).all()


@pytest.mark.parametrize("kind", [SimulatedEdge, SimulatedDevices])
def test_a_port_that_is_taken_is_bad_input(watched: Watched, kind: type) -> None:
    with SimulatedEdge(watched.plant) as taken:
        port = int(taken.address.rpartition(":")[2])
        with pytest.raises(InputError, match=f"port {port}: cannot be listened at"):
            kind(watched.plant, port=port).start()


@pytest.mark.parametrize("kind", [SimulatedEdge, SimulatedDevices])
def test_stopping_twice_is_no_error(watched: Watched, kind: type) -> None:
    partner = kind(watched.plant)
    partner.start()
    partner.stop()
    partner.stop()
