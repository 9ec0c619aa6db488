"""Both links keep the same promises, whatever the plant speaks."""

import time

import numpy as np
import pytest
from plant_partners import Connecting, N, Partner, Watched

from bess.edge.plant_io import LinkError, PlantLink, calls
from bess.edge.plant_io.simulated import Faults
from bess.errors import InputError

ASKED = np.array([40.0, -30.0, 92.0])
AFTER_ALL = 60.0
"""Seconds until either plant's watchdog acts."""


def test_what_is_read_is_what_the_strings_do(link: PlantLink, watched: Watched) -> None:
    for string, kw in enumerate(ASKED):
        watched.plant.ask(string, float(kw), np.inf)
    watched.clock.now_s += 1200.0
    said, true = link.read(), watched.plant.truth()
    assert said.soc == pytest.approx([t.soc for t in true], abs=0.006)
    assert said.power_kw == pytest.approx([t.power_kw for t in true], abs=0.01)
    assert said.temperature_c == pytest.approx([(t.coldest_c + t.hottest_c) / 2 for t in true], abs=0.6)
    assert said.available.all()
    assert said.time.tzinfo is not None


def test_limits_are_never_said_to_be_wider_than_they_are(link: PlantLink, watched: Watched) -> None:
    watched.plant.ask(0, 92.0, np.inf)
    watched.clock.now_s += 6000.0
    said, true = link.read(), watched.plant.truth()
    assert true[0].discharge_limit_kw < 1.0  # empty
    assert np.all(said.discharge_limit_kw <= [t.discharge_limit_kw for t in true])
    assert np.all(said.charge_limit_kw <= [t.charge_limit_kw for t in true])
    assert said.charge_limit_kw[0] > 50.0


def test_positive_set_points_discharge_and_negative_ones_charge(link: PlantLink, watched: Watched) -> None:
    link.write(ASKED)
    before = link.read().soc
    watched.clock.now_s += 59.0
    assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)
    for _ in range(20):
        link.write(ASKED)
        watched.clock.now_s += 59.0
    moved = link.read().soc - before
    assert moved[0] < 0.0 < moved[1]


def test_a_set_point_that_is_not_written_again_lapses(link: PlantLink, watched: Watched) -> None:
    link.write(ASKED)
    watched.clock.now_s += AFTER_ALL - 1.0
    assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)
    watched.clock.now_s += 2.0
    assert watched.power_kw().tolist() == [0.0] * N
    assert link.refresh_s < AFTER_ALL / 2


def test_nan_takes_back_one_string_and_leaves_the_others(link: PlantLink, watched: Watched) -> None:
    link.write(ASKED)
    link.write(np.array([np.nan, *ASKED[1:]]))
    assert watched.power_kw() == pytest.approx([0.0, *ASKED[1:]], abs=0.01)
    assert watched.plant.holds(0) is None


def test_release_takes_back_all_and_the_link_can_be_used_again(link: PlantLink, watched: Watched) -> None:
    link.write(ASKED)
    link.release()
    assert [watched.plant.holds(string) for string in range(N)] == [None] * N
    link.write(ASKED)
    assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)


def test_rounding_on_the_way_moves_no_set_point_by_a_watt_and_keeps_their_sum(
    link: PlantLink, watched: Watched
) -> None:
    def arrived() -> np.ndarray:
        return np.array([watched.plant.holds(string)[0] for string in range(N)])  # type: ignore[index]

    for wanted in (np.full(N, 100.0 / N), np.array([12.345678, -45.678999, 0.000998]), -np.full(N, 0.0015)):
        link.write(wanted)
        assert np.all(np.abs(arrived() - wanted) < 0.001)
        assert arrived().sum() == pytest.approx(np.trunc(1000.0 * wanted.sum() + 1e-6) / 1000.0)
        assert np.all((arrived() == 0.0) | (np.abs(arrived()) >= 0.001))
    whole_watts = np.array([0.001 * w for w in (4567, -91_999, 92_000)])
    link.write(whole_watts)
    assert arrived().tolist() == whole_watts.tolist()


@pytest.mark.parametrize("wrong", [[np.inf, 0.0, 0.0], [0.0] * (N - 1), [[0.0] * N]])
def test_what_is_no_set_point_is_refused_and_nothing_is_written(
    link: PlantLink, watched: Watched, wrong: list[float]
) -> None:
    with pytest.raises(InputError, match="expected 3 finite powers"):
        link.write(np.array(wrong))
    assert watched.asked == []


def test_a_lost_link_is_one_sentence_and_the_next_call_after_it_works(
    link: PlantLink, partner: Partner, watched: Watched
) -> None:
    link.write(ASKED)
    partner.stop()
    for attempt in (link.read, lambda: link.write(ASKED), link.release):
        with pytest.raises(LinkError, match=r"cannot be reached|not written"):
            attempt()
    watched.clock.now_s += AFTER_ALL + 1.0
    assert watched.power_kw().tolist() == [0.0] * N
    partner.start()
    assert link.read().available.all()
    link.write(ASKED)
    assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)


def test_a_server_that_was_restarted_between_two_calls_costs_at_most_one(
    link: PlantLink, partner: Partner, watched: Watched
) -> None:
    link.write(ASKED)
    partner.stop()
    partner.start()
    try:
        link.write(-ASKED)
    except LinkError:
        link.write(-ASKED)
    assert watched.power_kw() == pytest.approx(-ASKED, abs=0.5)


def test_a_slow_plant_is_an_error_after_a_stated_time(
    link: PlantLink, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    link.read()
    with monkeypatch.context() as short:
        short.setattr(calls, "DEADLINE_S", 0.5)
        _is_slow(link, watched)
    watched.plant.faults.delay_s = 0.0
    link.write(ASKED)
    assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)
    assert link.read().power_kw == pytest.approx(ASKED, abs=0.01)


def _is_slow(link: PlantLink, watched: Watched) -> None:
    watched.plant.faults.delay_s = 0.7
    began = time.monotonic()
    for attempt in (lambda: link.write(ASKED), link.read):
        with pytest.raises(LinkError, match=r"within|too slow"):
            attempt()
    assert time.monotonic() - began < 10.0


def test_powers_in_other_units_are_an_error_and_stop_all_writing(link: PlantLink, watched: Watched) -> None:
    watched.plant.faults.kilowatts = True
    for attempt in (link.read, lambda: link.write(ASKED)):
        with pytest.raises(LinkError, match="nothing is read or written until this is corrected"):
            attempt()
    assert watched.asked == []
    watched.plant.faults.kilowatts = False
    link.write(ASKED)
    assert watched.power_kw() == pytest.approx(ASKED, abs=0.01)


def test_units_that_change_while_driving_are_noticed_by_the_next_reading(
    link: PlantLink, watched: Watched
) -> None:
    link.write(ASKED)
    watched.plant.faults.kilowatts = True
    with pytest.raises(LinkError, match="is corrected"):
        link.read()
    watched.asked.clear()
    with pytest.raises(LinkError, match="is corrected"):
        link.write(ASKED)
    assert watched.asked == []


@pytest.mark.parametrize("fault", ["silent", "undefined"])
def test_a_string_of_which_nothing_is_known_leaves_the_others_alone(
    link: PlantLink, watched: Watched, fault: str
) -> None:
    link.write(ASKED)
    getattr(watched.plant.faults, fault).add(1)
    said = link.read()
    assert said.available.tolist() == [True, False, True]
    assert np.isnan([said.soc[1], said.power_kw[1], said.temperature_c[1]]).all()
    assert said.power_kw[[0, 2]] == pytest.approx(ASKED[[0, 2]], abs=0.01)
    getattr(watched.plant.faults, fault).clear()
    assert link.read().available.all()


def test_the_others_are_written_when_one_string_cannot_be(link: PlantLink, watched: Watched) -> None:
    link.read()
    watched.plant.faults.silent.add(0)
    with pytest.raises(LinkError, match=r"set-points of (ess0|unit 1 at 127.0.0.1:\d+) not written"):
        link.write(ASKED)
    assert watched.power_kw() == pytest.approx([0.0, *ASKED[1:]], abs=0.01)


def test_a_string_in_fault_says_so(link: PlantLink, watched: Watched) -> None:
    watched.plant.faults.dead.add(2)
    said = link.read()
    assert said.available.tolist() == [True, True, False]
    assert (said.charge_limit_kw[2], said.discharge_limit_kw[2]) == (0.0, 0.0)


def test_closing_twice_is_no_error(link: PlantLink) -> None:
    link.read()
    link.close()
    link.close()


def test_an_address_with_another_number_of_strings_is_refused(
    connecting: Connecting, partner: Partner
) -> None:
    option = "ess=ess0" if partner.address.startswith("openems") else "unit=1"
    with pytest.raises(InputError, match="expected 3 "):
        connecting(f"{partner.address}?{option}")


def test_strings_are_in_the_order_that_the_address_names(
    connecting: Connecting, partner: Partner, watched: Watched
) -> None:
    option = "ess=ess2,ess0,ess1" if partner.address.startswith("openems") else "unit=3,1,2"
    link = connecting(f"{partner.address}?{option}")
    link.write(ASKED)
    assert watched.power_kw()[[2, 0, 1]] == pytest.approx(ASKED, abs=0.01)
    assert link.read().power_kw == pytest.approx(ASKED, abs=0.01)


def test_no_faults_is_the_default() -> None:
    assert Faults() == Faults(*[set()] * 7, False, 0.0)
